"""The live hand-over: joins the estimates of trackers that share an area into one picture."""
