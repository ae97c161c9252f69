"""Node that publishes 20 malformed messages of each kind, and valid messages at the end."""

import io
import math

import rospy
from std_msgs.msg import Empty, Float64MultiArray, String

TOPIC = "/position_controller/command"
HOME = [0.0, 0.5, -1.0] * 4


class Torn(Float64MultiArray):
    """Message that announces more numbers than it contains."""

    def serialize(self, buffer: io.BytesIO) -> None:
        whole = io.BytesIO()
        super().serialize(whole)
        buffer.write(whole.getvalue()[:-16])


def publish(kind: type, *messages: object) -> None:
    publisher = rospy.Publisher(TOPIC, kind, queue_size=100)
    begin = rospy.get_time()
    while publisher.get_num_connections() == 0 and rospy.get_time() < begin + 0.5:
        rospy.sleep(0.01)
    for message in messages:
        publisher.publish(message)
        rospy.sleep(0.002)
    rospy.sleep(0.1)  # another thread sends the messages
    publisher.unregister()


rospy.init_node("malformed")
publish(String, *(String(data="trot!") for _ in range(20)))
publish(Empty, *(Empty() for _ in range(20)))
publish(Torn, *(Torn(data=HOME) for _ in range(20)))
for bad in (HOME[:11], [], [*HOME[:11], math.nan], [*HOME[:11], math.inf], [0.0] * 100_000):
    publish(Float64MultiArray, *(Float64MultiArray(data=bad) for _ in range(20)))
publish(Float64MultiArray, *(Float64MultiArray(data=HOME) for _ in range(20)))
