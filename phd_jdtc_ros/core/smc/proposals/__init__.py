"""Where particles are drawn: by the motion, by range rates, at detections and at birth."""
