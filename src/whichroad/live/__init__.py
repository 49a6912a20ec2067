"""The live service: sensors in as they come, estimates out as they are asked for."""
