//! Nothing: the tests beside this file and the examples join the crates of the workspace.
