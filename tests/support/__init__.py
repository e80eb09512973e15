"""What several tests share: cases, recordings, programs, plain computations to compare with."""
