"""Systems, and the verbs that users type on any of them."""
