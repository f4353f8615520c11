"""What commands are given: their options, settings, records and points of a survey."""
