"""The tables of an answer: their columns, their making, the words of a status, `Result`."""
