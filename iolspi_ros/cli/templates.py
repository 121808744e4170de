"""What `iolspi new-task` writes; each works as it is."""

PYTHON = '''"""@NAME@: a vehicle of one's own. A block that is pushed to the middle of a table.

    PYTHONPATH=. iolspi learn --task @NAME@:@CLASS@
    PYTHONPATH=. iolspi run simulator --task @NAME@:@CLASS@

sim_nodes.tasks.base.Task says what else it may have: a picture, a scripted pilot, a baseline.
"""

from dataclasses import dataclass

import numpy as np

from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action, Ending, TaskDescription, Variable

FORCES = (-1.0, 0.0, 1.0)  # [N]
DT = 0.1  # [s]
EDGE = 2.0  # [m]


@dataclass(frozen=True)
class @CLASS@(Settings):
    """State: position [m], zero in the middle; velocity [m/s]."""

    # Every field is a parameter of the simulator: -p friction:=0.5
    friction: float = setting(0.3, "drag of the table [N s/m]", low=0.0, high=10.0)

    description = TaskDescription(
        name="@NAME@",
        variables=(  # what is measured, with limits of what occurs
            Variable("position", "m", -EDGE, EDGE),
            Variable("velocity", "m/s", -3.0, 3.0),
        ),
        actions=tuple(Action(f"{force:+g} N", (force,)) for force in FORCES),
        neutral=1,  # the action that does nothing
        sampling_time=DT,
        episode_steps=60,  # then the clock cuts the episode
        gamma=0.95,  # how far it looks ahead: 1 / (1 - gamma) steps
        endings=(Ending("time-out", success=True), Ending("fell off")),
        success="stay on the table",
    )
    usual_episodes = 200  # in which it can be learned

    def step(self, state, action, time=0.0, noise=0.0):
        """Next state, reward, and whether the task ended; for one state or many at once."""
        position, velocity = np.moveaxis(np.asarray(state, float), -1, 0)
        force = np.take(FORCES, action) + noise
        velocity = np.clip(velocity + DT * (force - self.friction * velocity), -3.0, 3.0)
        position = position + DT * velocity
        fell = np.abs(position) > EDGE
        reward = -(position**2) - 0.1 * velocity**2 - 50.0 * fell
        return np.stack([position, velocity], axis=-1), reward, fell

    def initial_states(self):
        """Where policies are judged from, always the same: (n, n_dims)."""
        return np.array([(x, v) for x in (-1.5, 0.0, 1.5) for v in (-0.5, 0.5)])

    def draw_initial(self, rng):
        """One start at random, (n_dims,)."""
        return rng.uniform([-1.5, -0.5], [1.5, 0.5])
'''

ROBOT = """# @NAME@: a robot and its own topics. docs/own_vehicle.md says what each entry may be.
#
#     iolspi run vehicle --task @NAME@.yaml
#     iolspi run demonstrator --ros-args -p source:=joy -p record:=my_demonstration
#     iolspi run learner --ros-args -p background:=true -p checkpoint:=@NAME@.npz

name: @NAME@
variables:                      # what the learner sees, with limits of what occurs
  - {name: distance, unit: m, low: 0.0, high: 3.0}
  - {name: bearing, unit: rad, low: -3.1416, high: 3.1416, periodic: true}
actions:                        # what it may do: here speed [m/s] and turning rate [rad/s]
  - {name: stop, value: [0.0, 0.0]}
  - {name: forward, value: [0.3, 0.0]}
  - {name: left, value: [0.0, 1.0]}
  - {name: right, value: [0.0, -1.0]}
neutral: 0                      # sent whenever nobody answers
sampling_time: 0.2              # [s]
episode_steps: 100
gamma: 0.97
endings:                        # the first is the clock's
  - {name: time-out}
  - {name: arrived, when: "next.distance < 0.3", reward: 10.0, success: true}
success: arrive

# An expression over the variables, next.VARIABLE, action and value0, value1, …
reward: "-next.distance"

inputs:                         # what topics say, and variables are computed from
  x: {topic: odom, type: nav_msgs/msg/Odometry, field: pose.pose.position.x}
  y: {topic: odom, type: nav_msgs/msg/Odometry, field: pose.pose.position.y}
  heading: {topic: odom, type: nav_msgs/msg/Odometry, yaw: pose.pose.orientation}

state:                          # or a topic's field itself, or rate_of another variable
  distance: {expression: "hypot(x, y)"}
  bearing: {expression: "wrap(atan2(-y, -x) - heading)"}

command:                        # what an action publishes; beyond low and high it is refused
  topic: cmd_vel
  type: geometry_msgs/msg/Twist
  fields:
    linear.x: {value: value0, low: -0.5, high: 0.5}
    angular.z: {value: value1, low: -1.5, high: 1.5}

limits:                         # beyond them it gets the neutral action, whatever the learner wants
  distance: [0.0, 3.0]
allowed:                        # where an action is let through; else it becomes the neutral one
  forward: "distance < 2.9"

# How an episode begins: a service, a topic, or a person who puts the robot there and presses this
# button of the joystick.
reset: {button: 0, settle: 0.5}
"""

GYMNASIUM = """# @NAME@: an environment of Gymnasium, with what it does not say itself.
#
#     iolspi learn --task @NAME@.yaml --episodes 100

gymnasium: Pendulum-v1          # an id, or module:ID
arguments: {g: 9.81}            # of gymnasium.make
name: @NAME@
variables:                      # of the observation, in its order; what is left out it says itself
  - {name: cosine}
  - {name: sine}
  - {name: rate, unit: rad/s}
actions: [[-2.0], [0.0], [2.0]] # where a continuous action is cut
neutral: 1
gamma: 0.98
success_return: -300            # sum of rewards from which an episode is a success
starts: 10                      # seeds that policies are judged from
"""

TEMPLATES = {"python": PYTHON, "robot": ROBOT, "gymnasium": GYMNASIUM}
