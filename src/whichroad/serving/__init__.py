"""`whichroad serve`: one map for many callers, in the words of OSRM and Valhalla."""
