"""Code that the launch files share."""
