"""A differential drive on a plane, in plain rclpy: it knows nothing of this package.

    python examples/robot/robot.py            # in real time
    python examples/robot/robot.py --speed 10 # ten times as fast, with its time on /clock

Takes `cmd_vel` (geometry_msgs/Twist), publishes `odom` (nav_msgs/Odometry) every 0.02 s, stops by
itself when it has heard no command for 0.5 s, and drives to another start on `reset_robot`.
"""

import argparse
import math

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Empty

STEP = 0.02  # [s]
LAG = 0.1  # [s] time constant of its motors
PATIENCE = 0.5  # [s]


class Robot(Node):
    """Position [m], heading [rad], speed [m/s] and turning rate [rad/s]."""

    def __init__(self, speed, seed):
        super().__init__("robot")
        self.rng = np.random.default_rng(seed)
        self.time = self.heard = 0.0
        self.wanted = (0.0, 0.0)
        self.place()
        self.odom = self.create_publisher(Odometry, "odom", 10)
        self.clock = self.create_publisher(ClockMessage, "/clock", 10) if speed != 1.0 else None
        self.create_subscription(Twist, "cmd_vel", self.on_command, 10)
        self.create_service(Empty, "reset_robot", self.on_reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(STEP / speed, self.move, clock=steady)

    def place(self):
        x, y = self.rng.uniform(-1.5, 1.5, 2)
        self.pose = [x, y, self.rng.uniform(-math.pi, math.pi)]
        self.speed = self.turning = 0.0

    def on_reset(self, _, response):
        self.place()
        return response

    def on_command(self, message):
        self.wanted, self.heard = (message.linear.x, message.angular.z), self.time

    def move(self):
        self.time += STEP
        if self.time - self.heard > PATIENCE:
            self.wanted = (0.0, 0.0)
        self.speed += STEP / LAG * (self.wanted[0] - self.speed)
        self.turning += STEP / LAG * (self.wanted[1] - self.turning)
        self.pose[2] += STEP * self.turning
        self.pose[0] += STEP * self.speed * math.cos(self.pose[2])
        self.pose[1] += STEP * self.speed * math.sin(self.pose[2])
        self.say()

    def say(self):
        message = Odometry()
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(round(self.time * 1e9), 10**9)
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        pose = message.pose.pose
        pose.position.x, pose.position.y = self.pose[0], self.pose[1]
        pose.orientation.z = math.sin(self.pose[2] / 2)
        pose.orientation.w = math.cos(self.pose[2] / 2)
        message.twist.twist.linear.x = self.speed
        message.twist.twist.angular.z = self.turning
        self.odom.publish(message)
        if self.clock is not None:
            self.clock.publish(ClockMessage(clock=stamp))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(remove_ros_args()[1:])
    rclpy.init()
    try:
        rclpy.spin(Robot(options.speed, options.seed))
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
