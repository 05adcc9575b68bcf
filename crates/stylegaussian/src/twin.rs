//! The paper's equations, literally, in f64: what the fast path is compared with.
