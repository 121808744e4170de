"""The vehicle in three dimensions, against Lagrange, Newton and books."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from iolspi_ros.errors import InputError
from sim_nodes.quadrotor import body, cable
from sim_nodes.quadrotor.airframe import AR_DRONE_2, UTILITY, Payload, check_payload
from sim_nodes.quadrotor.body import SIZE, STAGES, move

G, DT = 9.81, 0.005
LOAD = Payload(mass=0.1, length=0.8, drag=0.0)
FREE = AR_DRONE_2._replace(drag_across=0.0, drag_along=0.0, rotor_low=0.0)
PILLAR = FREE._replace(mass=1e9, thrust=1e9, inertia_x=1e9, inertia_y=1e9, inertia_z=1e9)
CALM = np.zeros(3)


def flown(state, seconds, frame=FREE, payload=LOAD, command=None, wind=CALM, dt=DT, each=None):
    state, room = state.copy(), np.empty((STAGES, SIZE))
    command = state[body.ROTORS].copy() if command is None else command
    for _ in range(round(seconds / dt)):
        move(state, command, wind, frame, payload, dt, room)
        if each:
            each(state)
    return state


def wild(rng, frame=FREE, payload=LOAD):
    """A leaning, turning, swinging vehicle; the load parts from it at no speed."""
    angles = rng.uniform(-0.7, 0.7, 2)
    state = body.hovering(frame, payload, tuple(rng.uniform(-3, 3, 3)), tuple(angles))
    state[body.VELOCITY] = rng.normal(size=3)
    x, y, z, w = Rotation.from_euler("ZYX", rng.uniform(-0.5, 0.5, 3)).as_quat()
    state[body.ATTITUDE] = w, x, y, z
    state[body.RATES] = rng.uniform(-1, 1, 3)
    state[body.ROTORS] *= rng.uniform(0.97, 1.03, 4)
    across = np.cross(body.direction(*angles), rng.normal(size=3))
    state[body.LOAD_VELOCITY] = state[body.VELOCITY] + 1.5 * across
    return state


def energy(state, frame, payload):
    inertia = np.array([frame.inertia_x, frame.inertia_y, frame.inertia_z])
    return (
        0.5 * frame.mass * (state[body.VELOCITY] @ state[body.VELOCITY])
        + 0.5 * (inertia * state[body.RATES]) @ state[body.RATES]
        + 0.5 * payload.mass * (state[body.LOAD_VELOCITY] @ state[body.LOAD_VELOCITY])
        + G * (frame.mass * state[2] + payload.mass * state[19])
    )


# ------------------------------------------------------------------ Lagrange


def lagrange(frame, payload, forces):
    """d/dt of (q, q̇) from M(q) alone: Christoffel's symbols by complex steps, exact to rounding.

    q = x, y, z, roll, pitch, yaw, and the cable's angle to the vertical and around it.
    """
    M, m, L = frame.mass, payload.mass, payload.length
    J = np.diag([frame.inertia_x, frame.inertia_y, frame.inertia_z])

    def jacobians(q):
        roll, pitch, _, tip, around = q[3:]
        s, c = np.sin, np.cos
        rates = np.zeros((3, 8), complex)  # body rates from Euler's
        rates[:, 3:6] = [[1, 0, -s(pitch)], [0, c(roll), s(roll) * c(pitch)],
                         [0, -s(roll), c(roll) * c(pitch)]]  # fmt: skip
        load = np.zeros((3, 8), complex)  # of p + L (sin tip cos around, sin tip sin around, -cos)
        load[:, :3] = np.eye(3)
        load[:, 6] = L * np.array([c(tip) * c(around), c(tip) * s(around), s(tip)])
        load[:, 7] = L * np.array([-s(tip) * s(around), s(tip) * c(around), 0])
        return rates, load

    def mass(q):
        rates, load = jacobians(q)
        own = np.zeros((8, 8), complex)
        own[:3, :3] = M * np.eye(3)
        return own + rates.T @ J @ rates + m * load.T @ load

    def rhs(time, y):
        q, v, h = y[:8], y[8:], 1e-30
        slope = np.array([mass(q + 1j * h * e).imag / h for e in np.eye(8)])  # dM/dq_k
        coriolis = np.einsum("kij,k,j->i", slope, v, v) - 0.5 * np.einsum("kij,i,j->k", slope, v, v)
        rates, load = (j.real for j in jacobians(q + 0j))
        push, moments = forces(q)
        generalised = rates.T @ moments + load.T @ [0, 0, -m * G]
        generalised[:3] += push - [0, 0, M * G]
        return np.concatenate([v, np.linalg.solve(mass(q + 0j).real, generalised - coriolis)])

    return rhs


def test_it_moves_as_lagrange_says():
    rng = np.random.default_rng(0)
    frame = FREE._replace(rotor_time=1e9)  # rotors keep their speeds
    for _ in range(2):
        state = wild(rng)
        f = frame.thrust * state[body.ROTORS] ** 2
        d = frame.arm / np.sqrt(2.0)
        corners = np.array([[d, d, 0], [d, -d, 0], [-d, -d, 0], [-d, d, 0]])
        moments = np.cross(corners, np.outer(f, [0, 0, 1])).sum(axis=0)
        moments[2] += frame.torque / frame.thrust * (f @ [1, -1, 1, -1])

        def forces(q, f=f, moments=moments):
            body_z = Rotation.from_euler("ZYX", q[[5, 4, 3]]).as_matrix()[:, 2]
            return f.sum() * body_z, moments

        q = np.zeros(8)
        attitude = Rotation.from_quat(state[[7, 8, 9, 6]])
        q[:3], q[[5, 4, 3]] = state[:3], attitude.as_euler("ZYX")
        n = (state[body.LOAD] - state[:3]) / LOAD.length
        q[6], q[7] = np.arccos(-n[2]), np.arctan2(n[1], n[0])
        v = np.zeros(8)
        roll, pitch = q[3:5]
        euler = [[1, 0, -np.sin(pitch)], [0, np.cos(roll), np.sin(roll) * np.cos(pitch)],
                 [0, -np.sin(roll), np.cos(roll) * np.cos(pitch)]]  # fmt: skip
        v[:3], v[3:6] = state[3:6], np.linalg.solve(euler, state[body.RATES])
        slip = (state[body.LOAD_VELOCITY] - state[3:6]) / LOAD.length
        v[6] = slip @ [np.cos(q[6]) * np.cos(q[7]), np.cos(q[6]) * np.sin(q[7]), np.sin(q[6])]
        v[7] = slip @ [-np.sin(q[7]), np.cos(q[7]), 0] / np.sin(q[6])
        exact = solve_ivp(
            lagrange(frame, LOAD, forces), (0, 1), np.concatenate([q, v]), "DOP853",
            rtol=1e-11, atol=1e-11,
        ).y[:, -1]  # fmt: skip
        end = flown(state, 1.0, frame)
        assert end[body.CABLE] == cable.TAUT
        tip, around = exact[6:8]
        load = exact[:3] + LOAD.length * np.array(
            [np.sin(tip) * np.cos(around), np.sin(tip) * np.sin(around), -np.cos(tip)]
        )
        np.testing.assert_allclose(end[:3], exact[:3], atol=1e-6)
        np.testing.assert_allclose(end[3:6], exact[8:11], atol=1e-6)
        np.testing.assert_allclose(end[body.LOAD], load, atol=1e-6)
        turned = Rotation.from_quat(end[[7, 8, 9, 6]])
        off = turned * Rotation.from_euler("ZYX", exact[[5, 4, 3]]).inv()
        assert off.magnitude() < 1e-6


# ------------------------------------------------------------------ what is kept


@pytest.mark.parametrize("seed", range(5))
def test_energy_is_kept_without_thrust_and_air(seed):
    state = wild(np.random.default_rng(seed))
    state[body.ROTORS] = 0.0
    before = energy(state, FREE, LOAD)
    after = energy(flown(state, 2.0, command=np.zeros(4)), FREE, LOAD)
    assert after == pytest.approx(before, rel=1e-7)


def test_momentum_is_that_of_thrust_and_gravity():
    """Whatever the cable does, it moves none of it; here it is slack, caught and slack again."""
    state, kinds = wild(np.random.default_rng(1)), set()
    state[body.ROTORS] = 0.0
    state[body.CABLE] = cable.SLACK
    state[body.LOAD] = state[:3] + np.array([0.1, 0.2, 0.1])
    masses = np.array([FREE.mass, LOAD.mass])

    def momentum(state):
        return masses @ state[[[3, 4, 5], [20, 21, 22]]]

    end = flown(state, 1.5, command=np.zeros(4), each=lambda s: kinds.add(s[body.CABLE]))
    fallen = momentum(state) + masses.sum() * np.array([0, 0, -G * 1.5])
    np.testing.assert_allclose(momentum(end), fallen, atol=1e-10)
    assert kinds == {cable.SLACK, cable.TAUT}


@pytest.mark.parametrize("frame", [AR_DRONE_2, UTILITY])
def test_the_cable_keeps_its_length(frame):
    rng = np.random.default_rng(2)
    for _ in range(5):
        worst = []

        def look(state, worst=worst):
            away = np.linalg.norm(state[body.LOAD] - state[:3])
            if state[body.CABLE] == cable.TAUT:
                worst.append(abs(away - LOAD.length))
            else:
                assert away <= LOAD.length + 1e-9

        flown(wild(rng, frame), 3.0, frame, wind=np.array([4.0, -2.0, 0.5]), each=look)
        assert max(worst) < 1e-9


# ------------------------------------------------------------------ taut and slack


def test_it_swings_as_the_thesis_says():
    """T Eq. 18: a load that the vehicle does not feel, under one that accelerates evenly."""
    light, push = LOAD._replace(mass=1e-9), 2.5
    state = body.hovering(FREE, light, (0, 0, 5), (0.7, 0.0))
    lean = np.arctan2(push, G)
    state[6], state[8] = np.cos(lean / 2), np.sin(lean / 2)
    state[body.ROTORS] = FREE.hover / np.sqrt(np.cos(lean))

    def thesis(time, y):
        return [y[1], (-np.cos(y[0]) * push - np.sin(y[0]) * G) / light.length]

    exact = solve_ivp(thesis, (0, 1.2), [0.7, 0.0], rtol=1e-10, atol=1e-10).y[:, -1]
    angles = np.empty(4)
    body.swing(flown(state, 1.2, payload=light), angles)
    np.testing.assert_allclose(angles, [*exact, 0.0, 0.0], atol=1e-6)


def test_small_swings_of_both_have_their_period():
    """Free in the plane: ω² = (1 + m/M) g/L, where the vehicle hovers without a controller."""
    state = body.hovering(FREE, LOAD, (0, 0, 5), (1e-4, 0.0))
    omega = np.sqrt((1 + LOAD.mass / FREE.mass) * G / LOAD.length)
    angles = np.empty(4)
    body.swing(flown(state, 2.0), angles)
    assert angles[0] == pytest.approx(1e-4 * np.cos(2.0 * omega), abs=2e-9)


def test_a_spherical_pendulum_precesses():
    """Its ellipse turns by 3/8 of a b / L² in a radian of the swing (Olsson, 1978)."""
    load, a, b = LOAD._replace(length=1.0), 0.12, 0.06
    state = body.hovering(PILLAR, load, (0, 0, 5), (np.arcsin(a), 0.0))
    omega = np.sqrt(G / load.length)
    state[21] = b * omega
    track = []
    flown(state, 20.0, PILLAR, load, each=lambda s: track.append(s[17:19] - s[:2]))
    far = np.hypot(*np.array(track).T)
    late = np.flatnonzero(np.arange(len(far)) > 3700)
    x, y = track[late[np.argmax(far[late])]]
    turned = (np.arctan2(y, x) + np.pi / 2) % np.pi - np.pi / 2
    time = DT * (late[np.argmax(far[late])] + 1)
    assert turned == pytest.approx(3 / 8 * a * b * omega * time, rel=0.06)


@pytest.mark.parametrize("speed", [5.5, 6.3, 6.8])
def test_a_load_swung_up_goes_slack_where_books_say(speed):
    """With 2 g L < v² < 5 g L, at cos of (v² - 2 g L) / 3 g L to the upward vertical."""
    load, kinds, heights = LOAD._replace(length=1.0), [], []
    state = body.hovering(PILLAR, load, (0, 0, 5))
    state[20] = speed

    def look(state):
        kinds.append(state[body.CABLE])
        heights.append(state[19] - state[2])

    flown(state, 1.5, PILLAR, load, dt=0.001, each=look)
    slack = kinds.index(cable.SLACK)
    assert heights[slack] == pytest.approx((speed**2 - 2 * G) / (3 * G), abs=0.01)
    assert cable.TAUT in kinds[slack:]  # caught again


def test_a_slack_cable_is_caught_in_the_middle_of_a_step():
    """Two bodies in free fall part in a straight line, so the time of the pull is a square root."""
    state = body.hovering(FREE, LOAD, (0, 0, 5))
    state[body.ROTORS], state[body.CABLE] = 0.0, cable.SLACK
    gap, slip = np.array([0.3, 0.1, -0.6]), np.array([1.0, -2.0, -9.0])
    state[body.LOAD], state[body.LOAD_VELOCITY] = state[:3] + gap, slip
    roots = np.roots([slip @ slip, 2 * gap @ slip, gap @ gap - LOAD.length**2])
    time = roots.max()
    assert 0.0 < time < 0.02
    end = flown(state, 0.02, command=np.zeros(4), dt=0.02)
    unit = (gap + slip * time) / LOAD.length
    share = LOAD.mass / (LOAD.mass + FREE.mass)
    pulled = share * (slip @ unit) * unit  # what the vehicle gains at once
    after = slip - (slip @ unit) * unit
    exact = flown_apart(LOAD.length * unit, after, 0.02 - time)
    np.testing.assert_allclose(end[body.LOAD] - end[:3], exact, atol=1e-7)
    centre = (1 - share) * end[:3] + share * end[body.LOAD]
    begin = (1 - share) * state[:3] + share * state[body.LOAD]
    drift = begin + share * slip * 0.02 - [0, 0, G / 2 * 0.02**2]
    np.testing.assert_allclose(centre, drift, atol=1e-10)
    assert energy(end, FREE, LOAD) < energy(state, FREE, LOAD)
    assert np.linalg.norm(pulled) > 0.5  # it was a pull worth the name


def flown_apart(gap, slip, time):
    """A dumbbell that nothing turns goes round evenly."""
    rate = np.linalg.norm(slip) / np.linalg.norm(gap)
    return gap * np.cos(rate * time) + slip / rate * np.sin(rate * time)


def test_a_pull_takes_the_parting_speed_alone():
    state = wild(np.random.default_rng(3))
    slip = np.array([0.4, -1.0, -2.0])
    state[body.LOAD_VELOCITY] = state[3:6] + slip
    unit = (state[body.LOAD] - state[:3]) / LOAD.length
    before = FREE.mass * state[3:6] + LOAD.mass * state[body.LOAD_VELOCITY]
    assert cable.tighten(state, FREE.mass, LOAD) == pytest.approx(slip @ unit)
    after = FREE.mass * state[3:6] + LOAD.mass * state[body.LOAD_VELOCITY]
    np.testing.assert_allclose(after, before, atol=1e-12)
    left = state[body.LOAD_VELOCITY] - state[3:6]
    np.testing.assert_allclose(left, slip - (slip @ unit) * unit, atol=1e-12)


def test_what_is_let_go_flies_a_parabola_and_the_vehicle_is_lighter():
    state = wild(np.random.default_rng(4))
    start = state.copy()
    body.release(state)
    end = flown(state, 0.5)
    way = start[body.LOAD] + 0.5 * start[body.LOAD_VELOCITY] - [0, 0, G / 2 * 0.25]
    np.testing.assert_allclose(end[body.LOAD], way, atol=1e-9)
    assert end[5] > flown(start, 0.5)[5]


def test_the_air_carries_the_vehicle_with_it():
    frame = AR_DRONE_2._replace(drag_across=0.3, drag_along=0.7)
    state = body.hovering(frame, LOAD, (0, 0, 5))
    body.release(state)
    state[body.ROTORS] = frame.hover
    wind = np.array([2.0, -1.0, 0.0])
    end = flown(state, 3.0, frame, wind=wind)
    np.testing.assert_allclose(end[3:5], wind[:2] * (1 - np.exp(-0.3 * 3.0)), atol=1e-8)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mass": 0.0}, "mass of the load"), ({"mass": 1.0}, "mass of the load"),
        ({"mass": np.nan}, "is nan"), ({"length": 0.0}, "length of the cable"),
        ({"length": -1.0}, "length of the cable"), ({"length": np.inf}, "is inf"),
        ({"drag": -0.1}, "drag of the load"),
    ],
)  # fmt: skip
def test_impossible_loads_are_refused(values, words):
    with pytest.raises(InputError, match=words):
        check_payload(AR_DRONE_2, Payload(**values))


def test_many_move_as_one_does():
    rng = np.random.default_rng(5)
    states = np.stack([wild(rng) for _ in range(7)])
    commands, wind = states[:, body.ROTORS].copy(), rng.normal(size=(7, 3))
    together = states.copy()
    body.moves(together, commands, wind, FREE, LOAD, DT, 20)
    for n in range(7):
        alone = flown(states[n], 0.1, command=commands[n], wind=wind[n])
        np.testing.assert_array_equal(together[n], alone)
