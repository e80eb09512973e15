"""What commands share: arguments, output, progress, trainings and importers of data sets."""
