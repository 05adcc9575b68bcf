//! Learning-rate schedules.

/// The learning rate at step `done` of `total`: from `rate` to `rate * end` along half a cosine.
pub fn cosine(rate: f32, end: f32, done: u32, total: u32) -> f32 {
    // A schedule of 0 steps still has a rate.
    let course = 0.5 * (1.0 + (std::f32::consts::PI * done as f32 / total.max(1) as f32).cos());
    rate * (end + (1.0 - end) * course)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_falls_from_the_rate_to_its_end() {
        assert_eq!(cosine(2.0, 0.1, 0, 10), 2.0);
        assert!((cosine(2.0, 0.1, 5, 10) - 1.1).abs() < 1e-6, "halfway between 2 and 0.2");
        assert!((cosine(2.0, 0.1, 10, 10) - 0.2).abs() < 1e-6);
        assert!(cosine(2.0, 0.0, 10, 10).abs() < 1e-6);
        // The end is exact: 1 - 0.1 rounds to the same number as 0.9.
        assert_eq!(1.0_f32 - 0.1, 0.9);
    }
}
