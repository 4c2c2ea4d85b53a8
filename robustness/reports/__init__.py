"""Faults in the reports of radars: values, stamps, poses, sectors and numbers of detections."""
