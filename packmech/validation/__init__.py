"""What packmech measures of itself: hard cases, accuracy against time, and the reference model."""
