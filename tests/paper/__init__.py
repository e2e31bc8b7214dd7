"""The paper's table, figure and solvers on the simulator: `make paper`. Nothing that runs on a cart needs it."""
