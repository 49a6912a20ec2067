"""Whether the settings fit the data: consistency statistics of a drive, and findings from them."""
