"""What everything else stands on: arrays, errors, checks of input, files, the version."""
