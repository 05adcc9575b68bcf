//! The sRGB transfer function (IEC 61966-2-1), continued below 0 by its straight part and above 1 by its curve.

/// Display-referred from linear.
pub(super) fn display_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The slope of [`display_from_linear`].
pub(super) fn slope(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0) }
}

/// Linear from display-referred.
pub(super) fn linear_from_display(display: f32) -> f32 {
    if display <= 0.040_45 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // 0.5 is 188/255 on a display, give or take; 1 stays 1.
        assert!((display_from_linear(0.5) - 0.735_357).abs() < 1e-6);
        assert!((display_from_linear(1.0) - 1.0).abs() < 1e-6);
        for linear in [-0.5, 0.0, 0.001, 0.01, 0.2, 0.9, 1.5] {
            assert!((linear_from_display(display_from_linear(linear)) - linear).abs() < 2e-6, "{linear}");
            let difference = display_from_linear(linear + 5e-4) - display_from_linear(linear - 5e-4);
            assert!((difference / 1e-3 - slope(linear)).abs() < 0.02 * slope(linear), "{linear}");
        }
    }
}
