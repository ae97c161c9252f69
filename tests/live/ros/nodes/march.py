"""Node that publishes joint targets at 100 Hz: `march.py TABLE.json [sim]`, by wall time or by /clock."""

import json
import sys
from pathlib import Path

import rosgraph
import rospy
from std_msgs.msg import Float64MultiArray

if sys.argv[2:] == ["sim"]:
    rosgraph.Master("/march").setParam("/use_sim_time", True)
rospy.init_node("march")
publisher = rospy.Publisher("/position_controller/command", Float64MultiArray, queue_size=1)
rate = rospy.Rate(100)
while publisher.get_num_connections() == 0:
    rospy.rostime.wallsleep(0.01)
for targets in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")):
    publisher.publish(Float64MultiArray(data=targets))
    rate.sleep()
