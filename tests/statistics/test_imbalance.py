"""A rotor out of balance, two periods a turn, under random forces: order and deviations, by repetition."""

import numpy as np
import pytest
from tests.driven import ambient_of, imbalance_of, paper_rotor, pulls, record_of

from floquid import ConstantPeriod, Record, identify

DRAWS, PERIODS, PHASES = 10, 512, 24
SYSTEM = paper_rotor()


def identified(values, names, imbalance, scale, **options):
    values = values.copy()
    values[:4] += imbalance * scale * imbalance_of(SYSTEM, PERIODS, PHASES)
    clock = ConstantPeriod(period=SYSTEM.period)
    record = Record(values=values, sample_rate=PHASES / SYSTEM.period, channels=names[: len(values)], clock=clock)
    return identify(record, periods_per_revolution=2, **options or {"excitation": "ambient"})


@pytest.mark.parametrize("imbalance", [5.0, 50.0])
@pytest.mark.parametrize("measured", [True, False], ids=["measured forces", "outputs alone"])
def test_modes_of_a_rotor_out_of_balance(measured, imbalance):
    off, names = [], ["X", "Y", "X_t", "Y_t", "F_X", "F_Y"]
    for seed in range(DRAWS):
        if measured:
            values, forces = record_of(SYSTEM, PERIODS, PHASES, 0.02, seed)
            both = np.concatenate([values, forces])
            found = identified(both, names, imbalance, values.std(), inputs=names[4:])
        else:
            values = ambient_of(SYSTEM, PERIODS, PHASES, 0.02, seed)
            found = identified(values, names, imbalance, values.std())
        assert found.model.order == 4
        assert found.passed
        off.append(pulls(SYSTEM, found.model))
    assert 0.7 < np.sqrt(np.mean(np.array(off) ** 2)) < 1.3
    assert np.max(off) < 4.5
