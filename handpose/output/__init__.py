"""What leaves the program: pictures and pages, files of tracks, the live stream."""
