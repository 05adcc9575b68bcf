//! `demo_world OUT.(sgs|ply)`: writes the demo scene.
fn main() {}
