"""Where exactly a vehicle is, on which road, and how sure that is."""
