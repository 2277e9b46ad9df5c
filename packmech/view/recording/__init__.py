"""Recordings for the Rerun viewer: of packings, runs and played motions, frame by frame, and live."""
