import os

# Before anything imports rclpy: tests talk on this machine only, apart from other ROS processes,
# and leave no shared memory behind when they kill nodes.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)

from hypothesis import settings

settings.register_profile("project", deadline=None)
settings.load_profile("project")
