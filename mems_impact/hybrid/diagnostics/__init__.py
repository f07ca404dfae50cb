"""Diagnosis of failures in user functions."""
