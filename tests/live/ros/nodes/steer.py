"""Node that publishes one velocity at 20 Hz for a second, and then requests a new episode."""

import rospy
from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Empty

rospy.init_node("steer")
velocity = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
reset = rospy.Publisher("/reset", Empty, queue_size=1)
while not (velocity.get_num_connections() and reset.get_num_connections()):
    rospy.sleep(0.01)
for _ in range(20):
    velocity.publish(Twist(linear=Vector3(0.3, -0.1, 5.0), angular=Vector3(6.0, 7.0, 0.2)))
    rospy.sleep(0.05)
reset.publish(Empty())
rospy.sleep(0.5)
