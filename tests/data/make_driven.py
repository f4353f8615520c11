"""Make the records with measured inputs: a rotor in MuJoCo (`pip install mujoco`) and a pumped circuit.

The truth is the map that made the samples: of the rotor by finite differences of the engine's own step, of the circuit
by its transition over each sample. Neither has noise: tests add their own.
"""

from pathlib import Path

import mujoco  # pyright: ignore[reportMissingImports]
import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
PHASES, INNER = 40, 10
FREE = [0, 1, 3, 4, 5, 6]

MODEL = """
<mujoco>
 <option timestep="{step}" gravity="0 {gravity} 0" integrator="implicit"/>
 <worldbody><body name="housing">
  <joint type="slide" axis="1 0 0" stiffness="40000" damping="40"/>
  <joint type="slide" axis="0 1 0" stiffness="90000" damping="60"/>
  <geom type="box" size=".1 .1 .1" mass="3"/>
  <site name="housing"/>
  <body name="shaft">
   <joint type="hinge" axis="0 0 1" armature="1e9"/>
   <geom type="sphere" size=".01" mass=".05"/>
   <body name="disc">
    <joint type="slide" axis="1 0 0" stiffness="12000" damping="0.8"/>
    <joint type="slide" axis="0 1 0" stiffness="21000" damping="0.8"/>
    <joint type="hinge" axis="1 0 0" stiffness="140" damping=".006"/>
    <joint type="hinge" axis="0 1 0" stiffness="260" damping=".006"/>
    <inertial pos="{eccentricity} 0 0.02" mass="1.2" diaginertia=".004 .004 .008"/>
    <site name="disc" pos="0 0 0.05"/>
   </body>
  </body>
 </body></worldbody>
</mujoco>"""


class Rotor:
    """A housing on anisotropic springs, an asymmetric shaft and a disc that tilts, at a constant speed."""

    def __init__(self, turns_a_second, gravity=0.0, eccentricity=0.0):
        self.period = 1.0 / turns_a_second
        self.step_size = self.period / PHASES / INNER
        text = MODEL.format(step=self.step_size, gravity=gravity, eccentricity=eccentricity)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def sample(self, state, number, forces):
        """The outputs at a sample, and the state at the next one."""
        data, speed = self.data, 2.0 * np.pi / self.period
        mujoco.mj_resetData(self.model, data)
        data.qpos[FREE], data.qvel[FREE] = state[:6], state[6:]
        seen = None
        for inner in range(INNER):
            data.qpos[2], data.qvel[2] = speed * (number * INNER + inner) * self.step_size, speed
            if seen is None:
                mujoco.mj_kinematics(self.model, data)
                seen = data.site_xpos[:, :2].ravel().copy()
            data.qfrc_applied[:] = 0.0
            # On the housing along x, and on the disc along an axis that turns.
            data.qfrc_applied[[0, 3]] = forces
            mujoco.mj_step(self.model, data)
        return seen, np.concatenate([data.qpos[FREE], data.qvel[FREE]])

    def steady(self, periods=60):
        """The state at phase zero of the orbit that nothing but gravity and imbalance drive."""
        state = np.zeros(12)
        for number in range(periods * PHASES):
            state = self.sample(state, number % PHASES, (0.0, 0.0))[1]
        return state

    def exponents(self, state):
        """Exponents on the principal branch, by differences of the engine's step about an orbit."""
        whole = np.eye(12)
        for phase in range(PHASES):
            nudges = np.repeat([1e-5, 1e-3], 6)
            ends = [
                [self.sample(state + sign * own, phase, (0.0, 0.0))[1] for sign in (1.0, -1.0)]
                for own in np.diag(nudges)
            ]
            whole = (
                np.array([(up - down) / (2.0 * own) for (up, down), own in zip(ends, nudges, strict=True)]).T @ whole
            )
            state = self.sample(state, phase, (0.0, 0.0))[1]
        return np.log(np.linalg.eigvals(whole).astype(complex)) / self.period


def white(generator, samples):
    """Forces at random [N]: one sets the housing in motion, one the disc."""
    return generator.standard_normal((2, samples)) * np.array([[1.0], [0.3]])


def hits(generator, samples):
    """Blows of a hammer one into the next, on housing and disc in turn [N]."""
    forces, at = np.zeros((2, samples)), 0
    while at < samples - 60:
        where, width = generator.integers(2), generator.integers(4, 9)
        shape = np.sin(np.pi * (np.arange(width) + 0.5) / width)
        forces[where, at : at + width] += (3.6, 1.2)[where] * generator.uniform(0.5, 1.5) * shape
        at += int(generator.uniform(100, 260))
    return forces


def write(name, outputs, inputs, period, phases, exponents, channels, units):
    """Write a record with its truth."""
    np.savez_compressed(
        HERE / f"{name}.npz",
        values=np.concatenate([outputs, inputs]).astype(np.float32),
        sample_rate=round(phases / period, 9),
        period=period,
        exponents=exponents,
        channels=np.array(channels),
        units=np.array(units),
    )


def rotor(name, turns_a_second, periods, forces, **gravity):
    """A record of the rotor, from its orbit on."""
    system = Rotor(turns_a_second, **gravity)
    inputs = forces(np.random.default_rng(1), periods * PHASES)
    orbit = state = system.steady() if gravity else np.zeros(12)
    outputs = []
    for number, own in enumerate(inputs.T):
        seen, state = system.sample(state, number, own)
        outputs.append(seen)
    names = ["housing_x", "housing_y", "disc_x", "disc_y", "force_housing", "force_disc"]
    exponents, units = system.exponents(orbit), ["m"] * 4 + ["N"] * 2
    write(name, np.array(outputs).T, inputs, system.period, PHASES, exponents, names, units)


def circuit(name, periods=200, phases=64):
    """Two coils and two capacitors, one pumped so that nine harmonics count, driven by a voltage and a current."""
    period = 1e-3

    def pumped(t):
        return 1e-6 * (1.0 + 0.5 / (1.0 + np.exp(-5.0 * np.cos(2.0 * np.pi * t / period))))

    def rates(t):
        c = pumped(t)
        return np.array(
            [
                [-2e-4 / c, 0.0, 1.0, -1.0],
                [0.0, -1e-3 / 2.2e-6, 0.0, 1.0],
                [-1.0 / (10e-3 * c), 0.0, -14.0 / 10e-3, 0.0],
                [1.0 / (4e-3 * c), -1.0 / (4e-3 * 2.2e-6), 0.0, -6.0 / 4e-3],
            ]
        )

    forcing = np.array([[0.0, 1.0], [0.0, 0.0], [100.0, 0.0], [0.0, 0.0]])
    step, maps, whole = period / phases, [], np.eye(4)
    for phase in range(phases):

        def moved(t, flat):
            state = rates(t) @ flat.reshape(4, 6)
            state[:, 4:] += forcing
            return state.ravel()

        span = (phase * step, (phase + 1) * step)
        end = solve_ivp(moved, span, np.eye(4, 6).ravel(), method="DOP853", rtol=1e-11, atol=1e-16).y[:, -1]
        maps.append(end.reshape(4, 6))
        whole = maps[-1][:, :4] @ whole
    inputs = np.random.default_rng(1).standard_normal((2, periods * phases)) * np.array([[2.0], [5e-3]])
    state, outputs = np.zeros(4), []
    for number, own in enumerate(inputs.T):
        outputs.append([state[0] / pumped(number * step), state[2]])
        state = maps[number % phases] @ np.concatenate([state, own])
    exponents = np.log(np.linalg.eigvals(whole).astype(complex)) / period
    write(
        name, np.array(outputs).T, inputs, period, phases, exponents, ["v", "i", "source", "feed"], ["V", "A", "V", "A"]
    )


if __name__ == "__main__":
    rotor("driven_rotor_gravity", 9.0, 200, white, gravity=-9.81, eccentricity=2e-5)
    rotor("driven_rotor_hits", 12.0, 240, hits)
    circuit("driven_circuit")
