"""Engines that outside hands drive step by step: batches of packings advanced in one compiled call."""
