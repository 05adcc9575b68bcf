//! The demo scene as a whole: its size, its validity, and a fingerprint against unnoticed changes.

use std::sync::LazyLock;

use stylegaussian::Scene;

static ISLAND: LazyLock<Scene> = LazyLock::new(demo_world::build);

/// FNV-1a of the scene's numbers. If a change of the world is intended, the failing test names the new value.
const FINGERPRINT: u64 = 0x79d2_220d_f3d4_0d65;

fn fingerprint(scene: &Scene) -> u64 {
    let sh = scene.sh.as_ref().map_or(&[][..], |sh| &sh.coefficients);
    let vectors = scene.means.iter().chain(&scene.scales).flat_map(|v| v.to_array());
    let rotations = scene.rotations.iter().flat_map(|q| q.to_array());
    vectors
        .chain(rotations)
        .chain(scene.opacities.iter().copied())
        .chain(sh.iter().copied())
        .flat_map(|value| value.to_bits().to_le_bytes())
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn has_sixty_to_seventy_thousand_gaussians() {
    assert!((60_000..=70_000).contains(&ISLAND.len()), "{}", ISLAND.len());
}

#[test]
fn is_a_valid_scene() {
    for index in 0..ISLAND.len() {
        assert!(ISLAND.means[index].is_finite());
        assert!((ISLAND.rotations[index].length() - 1.0).abs() < 1e-5);
        assert!(ISLAND.scales[index].is_finite() && ISLAND.scales[index].min_element() > 0.0);
        assert!(ISLAND.scales[index].max_element() < 0.3, "{} is too large", ISLAND.scales[index]);
        assert!((0.0..1.0).contains(&ISLAND.opacities[index]));
    }
    assert_eq!(ISLAND.order.len(), ISLAND.len());
    assert_eq!(ISLAND.n_source, ISLAND.len());
}

#[test]
fn colors_are_displayable_and_varied() {
    let colors = ISLAND.base_colors();
    let tolerance = 1e-5;
    assert!(colors.iter().flatten().all(|c| (-tolerance..=1.0 + tolerance).contains(c)));
    for channel in 0..3 {
        let mean = colors.iter().map(|c| c[channel]).sum::<f32>() / colors.len() as f32;
        let variance = colors.iter().map(|c| (c[channel] - mean) * (c[channel] - mean)).sum::<f32>()
            / colors.len() as f32;
        assert!(variance.sqrt() > 0.1, "channel {channel} is flat");
    }
}

#[test]
fn is_the_same_every_time_and_everywhere() {
    let found = fingerprint(&ISLAND);
    assert_eq!(found, fingerprint(&demo_world::build()), "two builds in one process differ");
    assert_eq!(
        found, FINGERPRINT,
        "the world changed: if that was meant, the new fingerprint is {found:#018x}"
    );
}
