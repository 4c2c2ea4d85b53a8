"""A bond with the interface of bondpy 4, that sends its heartbeats as text.

It sends "ID alive" while it lasts, from a thread of its own, and "ID dead" at the end. It is formed
when the other side, which is called SISTER, has sent something.
"""

import threading

from std_msgs.msg import String

SISTER = "manager"


class Bond:
    def __init__(self, node, topic, id, on_broken=None, on_formed=None):
        self.heartbeat_period = 1.0
        self._node, self._topic, self._id = node, topic, id
        self._on_broken, self._on_formed = on_broken, on_formed
        self._ended = threading.Event()
        self._output = node.create_publisher(String, topic, 1)

    def start(self):
        self._input = self._node.create_subscription(String, self._topic, self._hear, 1)
        self._thread = threading.Thread(target=self._beat, daemon=True)
        self._thread.start()

    def break_bond(self):
        self._ended.set()
        self._thread.join()
        self._output.publish(String(data=f"{self._id} dead"))

    def shutdown(self):
        self._input.destroy()
        self.break_bond()
        self._output.destroy()
        self._on_broken()

    def _beat(self):
        while not self._ended.is_set():
            self._output.publish(String(data=f"{self._id} alive"))
            self._ended.wait(self.heartbeat_period)

    def _hear(self, message):
        if message.data == SISTER and self._on_formed:
            self._on_formed()
            self._on_formed = None
