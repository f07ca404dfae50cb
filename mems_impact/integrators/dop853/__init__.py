"""Dormand and Prince's method of order 8: one-step, explicit, at full order from the first step."""
