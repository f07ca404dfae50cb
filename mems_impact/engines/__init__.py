"""The engines: what integrates an arc, behind one small contract, each method in its own folder."""
