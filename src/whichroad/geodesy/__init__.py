"""Degrees, planes and units: geodetic positions and the map's plane, bearings and headings."""
