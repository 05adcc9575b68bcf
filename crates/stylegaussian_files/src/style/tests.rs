//! Styles and their paint, written and read.

use stylegaussian::{paint::Paint, statistics::ChannelStatistics};

use crate::{
    read_paint, read_style, style_to_bytes,
    tests::{dir, refused},
    write_painted_style, write_style,
};

#[test]
fn style_round_trips() {
    let dir = dir();
    let path = dir.path().join("a.style.safetensors");
    let mut style = ChannelStatistics {
        mean: vec![1.0, -2.0],
        std_dev: vec![0.5, 0.0],
        covariance: Some(vec![0.25, 0.0, 0.0, 0.0]),
        encoder: Some("vgg@00ff".parse().unwrap()),
    };
    write_style(&path, &style).unwrap();
    assert_eq!(read_style(&path).unwrap(), style);
    assert_eq!(style_to_bytes("a", &style).unwrap(), std::fs::read(&path).unwrap());
    style.covariance = None;
    style.encoder = None;
    write_style(&path, &style).unwrap();
    assert_eq!(read_style(&path).unwrap(), style);
    for (mean, std_dev) in [(f32::NAN, 1.0), (0.0, -1.0), (0.0, f32::INFINITY)] {
        let bad = ChannelStatistics { mean: vec![mean], std_dev: vec![std_dev], ..Default::default() };
        assert!(refused(write_style(&path, &bad)).contains("a.style.safetensors"));
        assert!(refused(style_to_bytes("b.style.safetensors", &bad)).contains("b.style.safetensors"));
    }
    assert_eq!(read_style(&path).unwrap(), style, "a refused write leaves the old file");
}

#[test]
fn paint_round_trips_beside_statistics() {
    let dir = dir();
    let path = dir.path().join("a.style.safetensors");
    let style = ChannelStatistics { mean: vec![1.0], std_dev: vec![0.5], ..Default::default() };
    write_style(&path, &style).unwrap();
    assert_eq!(read_paint(&path).unwrap(), None, "a style of before has none");
    let pixels = (0..9 * 8 * 3).map(|i| i as u8).collect();
    let paint = Paint { width: 9, height: 8, pixels, used: None };
    write_painted_style(&path, &style, &paint).unwrap();
    assert_eq!(read_style(&path).unwrap(), style);
    assert_eq!(read_paint(&path).unwrap().as_ref(), Some(&paint));
    for bad in [Paint { width: 10, ..paint.clone() }, Paint { width: 0, pixels: Vec::new(), ..paint.clone() }]
    {
        assert!(refused(write_painted_style(&path, &style, &bad)).contains("a.style.safetensors"));
    }
    assert_eq!(read_paint(&path).unwrap().as_ref(), Some(&paint), "a refused write leaves the old file");
    let used = Some((0..72).map(|i| i % 7 != 0).collect());
    let part = Paint { used, ..paint.clone() };
    write_painted_style(&path, &style, &part).unwrap();
    assert_eq!(read_paint(&path).unwrap().as_ref(), Some(&part));
    let bad = Paint { used: Some(vec![true; 71]), ..paint };
    assert!(refused(write_painted_style(&path, &style, &bad)).contains("71"));
}
