"""Interface of Unitree's robots on the network: messages over DDS, a simulated robot, and a client with a policy.

Names, field order and widths of the messages, their checksum, and the motor order are equal to Unitree's SDK2. The
modules do not use the SDK.
"""
