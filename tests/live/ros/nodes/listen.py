"""Node that records the messages of the robot: `listen.py SECONDS FILE`, a JSON list of [topic, wall time, fields]."""

import json
import sys
import time
from pathlib import Path

import rospy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

received = []
rospy.init_node("listen", anonymous=True)


def on_clock(clock: Clock) -> None:
    received.append(["/clock", time.time(), {"stamp": clock.clock.to_nsec()}])


def on_imu(imu: Imu) -> None:
    turn, force = imu.orientation, imu.linear_acceleration
    reading = {"turn": [turn.x, turn.y, turn.z, turn.w], "force": [force.x, force.y, force.z]}
    received.append(["/imu", time.time(), {"stamp": imu.header.stamp.to_nsec(), **reading}])


def on_joint_states(state: JointState) -> None:
    reading = {"name": state.name, "position": state.position, "velocity": state.velocity, "effort": state.effort}
    received.append(["/joint_states", time.time(), {"stamp": state.header.stamp.to_nsec(), **reading}])


rospy.Subscriber("/clock", Clock, on_clock)
rospy.Subscriber("/imu", Imu, on_imu)
rospy.Subscriber("/joint_states", JointState, on_joint_states)
rospy.rostime.wallsleep(float(sys.argv[1]))
Path(sys.argv[2]).write_text(json.dumps(received), encoding="utf-8")
