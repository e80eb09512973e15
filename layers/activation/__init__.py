"""One value in, one value out: functions of single values."""
