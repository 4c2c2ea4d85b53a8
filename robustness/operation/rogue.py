"""A rogue peer: ``python -m robustness.operation.rogue SECONDS``, in another network namespace.

It publishes clouds on the topic of a tracker's first radar and tries to change a parameter. At the
end it prints the outcome as JSON. `ROS_STATIC_PEERS` gives it the address.
"""

from __future__ import annotations

import json
import sys
import time

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from msg_adapters.encoding import names

FRAME = "rogue"
PARAMETER = "existence"
PERIOD_S = 0.05


def main(seconds: float) -> None:
    """Attack for `seconds` and print the outcome."""
    rclpy.init()
    node = rclpy.create_node("rogue")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    output = node.create_publisher(PointCloud2, names.detections("radar_1"), 10)
    client = node.create_client(SetParameters, f"{names.TRACKER}/set_parameters")
    cloud = PointCloud2(header=Header(frame_id=FRAME))
    change = Parameter(PARAMETER, value=[0.61]).to_parameter_msg()
    subscriptions, written = 0, 0
    calls: list[Future] = []
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        subscriptions = max(subscriptions, output.get_subscription_count())
        output.publish(cloud)
        if client.service_is_ready() and len(calls) < 5:
            calls.append(client.call_async(SetParameters.Request(parameters=[change])))
        executor.spin_once(timeout_sec=PERIOD_S)
    for call in calls:
        if call.done():
            written += sum(result.successful for result in call.result().results)
    seen = len([name for name, _ in node.get_node_names_and_namespaces() if name != "rogue"])
    outcome = {"subscriptions": subscriptions, "parameter_writes": written, "nodes_seen": seen}
    print(json.dumps(outcome))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(float(sys.argv[1]))
