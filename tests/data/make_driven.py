"""Make the records with forces, measured or not: rotors in MuJoCo (`pip install mujoco`) and a pumped circuit.

The truth is the map that made the samples: of a rotor by finite differences of the engine's own step, of the circuit
by its transition over each sample. None has noise: tests add their own.
"""

from pathlib import Path

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
PHASES, INNER = 40, 10

DISC = """
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


BLADES = """
<mujoco>
 <option timestep="{step}" gravity="0 {gravity} 0" integrator="implicit"/>
 <worldbody><body name="tower">
  <joint type="slide" axis="1 0 0" stiffness="700" damping="8"/>
  <joint type="slide" axis="0 1 0" stiffness="1500" damping="10"/>
  <geom type="box" size=".1 .1 .1" mass="8"/>
  <site name="tower"/>
  <body name="hub">
   <joint type="hinge" axis="0 0 1" armature="1e9"/>
   <geom type="sphere" size=".01" mass=".05"/>
   <body name="one" pos=".2 0 0">
    <joint type="hinge" axis="0 0 1" stiffness="30" damping=".15"/>
    <inertial pos=".5 0 0" mass="1" diaginertia=".001 .08 .08"/>
   </body>
   <body name="two" pos="-.2 0 0">
    <joint type="hinge" axis="0 0 1" stiffness="36" damping=".15"/>
    <inertial pos="-.5 0 0" mass="1" diaginertia=".001 .08 .08"/>
   </body>
  </body>
 </body></worldbody>
</mujoco>"""


class Rotor:
    """A model whose third joint turns at a constant speed; sites are seen along x and y, and the joints after it.

    Of `DISC` a housing on anisotropic springs, an asymmetric shaft and a disc that tilts; of `BLADES` a tower with two
    blades that lag.
    """

    def __init__(self, turns_a_second, text=DISC, gravity=0.0, eccentricity=0.0):
        self.period = 1.0 / turns_a_second
        self.step_size = self.period / PHASES / INNER
        text = text.format(step=self.step_size, gravity=gravity, eccentricity=eccentricity)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.free = [joint for joint in range(self.model.nv) if joint != 2]

    def sample(self, state, number, forces):
        """The outputs at a sample, and the state at the next one, of forces on the free joints."""
        data, speed, free = self.data, 2.0 * np.pi / self.period, self.free
        mujoco.mj_resetData(self.model, data)
        data.qpos[free], data.qvel[free] = state[: len(free)], state[len(free) :]
        seen = None
        for inner in range(INNER):
            data.qpos[2], data.qvel[2] = speed * (number * INNER + inner) * self.step_size, speed
            if seen is None:
                mujoco.mj_kinematics(self.model, data)
                seen = np.append(data.site_xpos[:, :2], data.qpos[3:])
            data.qfrc_applied[:] = 0.0
            data.qfrc_applied[free] = forces
            mujoco.mj_step(self.model, data)
        return seen, np.concatenate([data.qpos[free], data.qvel[free]])

    def steady(self, periods=60):
        """The state at phase zero of the orbit that nothing but gravity and imbalance drive."""
        state = np.zeros(2 * len(self.free))
        for number in range(periods * PHASES):
            state = self.sample(state, number % PHASES, 0.0)[1]
        return state

    def exponents(self, state, half=False):
        """Exponents on the principal branch, by differences of the engine's step about an orbit.

        Those of half a turn are of a model that is then as before, but for the sign of what turns: `DISC` without
        imbalance, seen from the fixed frame.
        """
        whole, nudges = np.eye(len(state)), np.repeat([1e-5, 1e-3], len(self.free))
        for phase in range(PHASES // 2 if half else PHASES):
            ends = [[self.sample(state + sign * own, phase, 0.0)[1] for sign in (1.0, -1.0)] for own in np.diag(nudges)]
            whole = (
                np.array([(up - down) / (2.0 * own) for (up, down), own in zip(ends, nudges, strict=True)]).T @ whole
            )
            state = self.sample(state, phase, 0.0)[1]
        if half:
            whole *= np.where(np.arange(len(whole)) % len(self.free) < 2, 1.0, -1.0)[:, None]
        return np.log(np.linalg.eigvals(whole).astype(complex)) / self.period * (2.0 if half else 1.0)


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
    """A record of the rotor, from its orbit on, forces along x on the housing and along an axis that turns."""
    system = Rotor(turns_a_second, **gravity)
    inputs = forces(np.random.default_rng(1), periods * PHASES)
    orbit = system.steady() if gravity else np.zeros(12)
    on_joints = np.zeros((6, periods * PHASES))
    on_joints[[0, 2]] = inputs
    outputs = driven(system, orbit, on_joints)[:4]
    names = ["housing_x", "housing_y", "disc_x", "disc_y", "force_housing", "force_disc"]
    exponents, units = system.exponents(orbit), ["m"] * 4 + ["N"] * 2
    write(name, outputs, inputs, system.period, PHASES, exponents, names, units)


def driven(system, state, forces):
    """The outputs (outputs, samples) from a state on, of forces on the free joints."""
    outputs = []
    for number, own in enumerate(forces.T):
        seen, state = system.sample(state, number, own)
        outputs.append(seen)
    return np.array(outputs).T


def ambient(name, turns_a_second, turns, sizes, channels, units, half=False, warm=60, **model):
    """A record of a rotor that white forces of these sizes on all free joints drive; none of them is kept."""
    system = Rotor(turns_a_second, **model)
    orbit = system.steady()
    forces = np.random.default_rng(1).standard_normal((len(sizes), (turns + warm) * PHASES))
    outputs = driven(system, orbit, np.array(sizes)[:, None] * forces)[: len(channels), warm * PHASES :: 2]
    period, phases = (0.5 * system.period, PHASES // 4) if half else (system.period, PHASES // 2)
    none = np.zeros((0, outputs.shape[1]))
    write(name, outputs, none, period, phases, system.exponents(orbit, half), channels, units)


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
    sizes = [0.2, 0.2, 0.06, 0.06, 0.002, 0.002]
    names = ["housing_x", "housing_y", "disc_x", "disc_y"]
    ambient("ambient_rotor", 9.0, 1000, sizes, names, ["m"] * 4, half=True, gravity=-9.81)
    sizes, names = [0.5, 0.5, 0.05, 0.05], ["tower_x", "tower_y", "lag"]
    ambient("ambient_blades", 2.0, 2400, sizes, names, ["m", "m", "rad"], text=BLADES)
