"""Where particles are drawn: by the motion, at detections and at birth."""
