"""The paper against the code: every statement of it, figure by figure, with a verdict."""
