"""Verbs of the public interface that apply to any system, and their results."""
