"""Parks the robot as a person with a joystick would: one button for each action, in plain rclpy.

    python examples/robot/teacher.py
    iolspi run demonstrator --ros-args -p source:=joy -p joy_buttons:=[0,1,2,3,4] \
        -p record:=my_parking -p episodes:=10

Turns towards the origin and drives there.
"""

import math

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Joy

STOP, FORWARD, BACKWARD, LEFT, RIGHT = range(5)


def choose(x, y, heading):
    if math.hypot(x, y) < 0.2:
        return STOP
    error = math.remainder(math.atan2(-y, -x) - heading, 2 * math.pi)
    if abs(error) < 0.3:
        return FORWARD
    if abs(error) > math.pi - 0.3:
        return BACKWARD
    turning = error if abs(error) < math.pi / 2 else -error
    return LEFT if turning > 0 else RIGHT


class Teacher(Node):
    """Presses buttons."""

    def __init__(self):
        super().__init__("teacher")
        self.joy = self.create_publisher(Joy, "joy", 10)
        self.seen = 0
        self.create_subscription(Odometry, "odom", self.look, 10)

    def look(self, message):
        pose = message.pose.pose
        heading = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        pressed = choose(pose.position.x, pose.position.y, heading)
        self.seen += 1
        if self.seen % 100 < 5:  # lets go now and then: a demonstration begins at a press
            pressed = None
        self.joy.publish(Joy(axes=[0.0], buttons=[int(n == pressed) for n in range(5)]))


def main():
    rclpy.init()
    try:
        rclpy.spin(Teacher())
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
