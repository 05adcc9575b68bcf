//! EWA splatting on the CPU.
