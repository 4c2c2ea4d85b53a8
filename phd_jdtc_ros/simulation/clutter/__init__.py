"""False detections: clutter, fixed reflectors, echoes and mirrored replies."""
