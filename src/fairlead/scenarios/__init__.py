"""The simulated worlds. The only package that imports MuJoCo."""
