# Tests that wait the longest begin before others, so that none of them is the last one to end.
foreach(name IN ITEMS
    "a run that never met its lidar leaves no session in the way of the next attempt"
    "a turning stage distorts scans, and its rate takes the distortion out again"
    "after every single fault of the catalogue scans are right and the stage is where it says"
    "a device that answers garbage ends the run, and endless garbage does not fill the memory"
    "another service at the lidar's port is told from a lidar"
    "an investigation that is killed between any two of its steps, and within a session, goes on where it was"
    "range procedures run unattended on the simulated bench and lead to a correction that validates"
    "in the middle of a long move the stage is stopped by Ctrl-C, and when the run is killed or hangs")
  set_tests_properties("integration:${name}" PROPERTIES COST 20)
endforeach()
