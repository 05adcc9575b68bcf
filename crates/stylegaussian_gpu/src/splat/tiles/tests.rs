//! The lists against the pixels themselves, in f64.

use glam::{Affine3A, DVec2, Mat4, Vec3};
use stylegaussian::Scene;
use stylegaussian_shaders::splat::SplatCounts;

use super::*;
use crate::{
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, GpuScene, SplatPass, SplatSettings, SplatView,
        testing::{gpu, random_splats, read},
    },
};

/// Splats of all shapes and opacities in front of the camera and beside its picture.
fn random_scene(n: usize) -> Scene {
    random_splats(n, Vec3::new(-2.0, -2.0, -1.0), Vec3::new(4.0, 4.0, -3.0), 0.4)
}

/// The parts of a record that determine alpha.
struct Footprint {
    center: DVec2,
    slope: f64,
    precision: DVec2,
    opacity: f64,
}

impl Footprint {
    fn new([x, y, slope, row]: [f32; 4], color: [u32; 4]) -> Self {
        let opacity = half::f16::from_bits((color[3] >> 16) as u16).to_f64();
        let precision = DVec2::new(f64::from(row), f64::from(f32::from_bits(color[0])));
        Self { center: DVec2::new(f64::from(x), f64::from(y)), slope: f64::from(slope), precision, opacity }
    }

    fn alpha(&self, pixel: DVec2) -> f64 {
        let d = pixel - self.center;
        let du = d.x - self.slope * d.y;
        self.opacity * (-0.5 * (self.precision.x * du * du + self.precision.y * d.y * d.y)).exp()
    }

    /// Half the size of the bounding box.
    fn extent(&self) -> DVec2 {
        let variance_y = 1.0 / self.precision.y;
        let variance = DVec2::new(1.0 / self.precision.x + self.slope * self.slope * variance_y, variance_y);
        let k = (2.0 * (self.opacity * 255.0).ln()).max(0.0);
        DVec2::new((k * variance.x).sqrt(), (k * variance.y).sqrt())
    }
}

/// Each list names in order all splats that a pixel of its tile shows, and none whose bounding box ends before
/// the tile. Pictures of whole and of cut tiles, in the middle of a target, one after the other in one view.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &random_scene(700)).unwrap();
    let (pass, tiles, mut view) = (SplatPass::by_quads(device), Tiles::new(device), SplatView::new());
    for viewport in [UVec4::new(0, 0, 64, 48), UVec4::new(5, 3, 61, 45), UVec4::new(7, 0, 90, 9)] {
        let camera = Camera {
            world_from_view: Affine3A::IDENTITY,
            clip_from_view: Mat4::perspective_infinite_reverse_rh(
                0.9,
                viewport.z as f32 / viewport.w as f32,
                0.1,
            ),
            viewport,
        };
        let cloud = Cloud {
            scene: &scene,
            colors: CloudColors::Captured,
            world_from_scene: Affine3A::IDENTITY,
            visibility: None,
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let settings = SplatSettings::default();
        pass.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, &camera, &[cloud], &settings)
            .unwrap();
        let lists = view.lists(device, queue, &tiles).unwrap();
        tiles.fill(&mut encoder, lists);
        assert!(lists.is_filled);
        queue.submit([encoder.finish()]);

        let (ends, entries) = (read::<u32>(&gpu, &lists.run_counts), read::<u32>(&gpu, &lists.entries));
        let segments = read::<u32>(&gpu, &lists.segments);
        let commands = read::<SplatCommands>(&gpu, &lists.commands)[0];
        let columns = lists.n_tiles.x;
        let n_tiles = product(lists.n_tiles) as u32;
        assert_eq!(
            (commands.n_groups, commands.n_instances),
            (n_tiles.div_ceil(shaders::TILES_PER_WORKGROUP), 0)
        );
        let sort = view.sort().unwrap();
        let n_visible = read::<SplatCounts>(&gpu, &sort.counts)[0].n_visible as usize;
        let sorted: Vec<u32> = read(&gpu, &sort.record_indices);
        let (geometry, color) = view.records().unwrap();
        let (geometry, color): (Vec<[f32; 4]>, Vec<[u32; 4]>) = (read(&gpu, geometry), read(&gpu, color));

        let mut begin = 0;
        for tile in 0..n_tiles {
            let end =
                segments[(tile / TILES_PER_SEGMENT) as usize] + ends[(tile * N_RUNS + N_RUNS - 1) as usize];
            let end = end as usize;
            let mut list = entries[begin..end].iter().peekable();
            begin = end;
            let corner = UVec2::new(tile % columns, tile / columns) * TILE_SIZE;
            let first = corner + UVec2::new(viewport.x, viewport.y);
            let size = UVec2::splat(TILE_SIZE).min(UVec2::new(viewport.z, viewport.w) - corner);
            for &record in &sorted[..n_visible] {
                let footprint = Footprint::new(geometry[record as usize], color[record as usize]);
                let pixels = (0..size.x * size.y).map(|i| first + UVec2::new(i % size.x, i / size.x));
                // Rounding decides whether an alpha of 1/255 is drawn.
                let is_seen =
                    pixels.into_iter().any(|pixel| footprint.alpha(pixel.as_dvec2() + 0.5) > 1.01 / 255.0);
                let is_listed = list.next_if_eq(&&record).is_some();
                assert!(is_listed || !is_seen, "tile {tile} does not list {record}");
                let middle = first.as_dvec2() + f64::from(TILE_SIZE) / 2.0;
                let apart = (footprint.center - middle).abs() - footprint.extent();
                let is_near = apart.max_element() < f64::from(TILE_SIZE) / 2.0 + 0.01;
                // Splats beside the picture may be listed at its edge.
                let center = footprint.center - DVec2::new(f64::from(viewport.x), f64::from(viewport.y));
                let last = DVec2::new(f64::from(viewport.z), f64::from(viewport.w));
                let is_within = center.cmpge(DVec2::ZERO).all() && center.cmplt(last).all();
                assert!(!is_listed || is_near || !is_within, "tile {tile} lists {record} in vain");
            }
            assert_eq!(list.next(), None, "tile {tile} lists what is out of order or not visible");
        }
        assert!(begin > 1000, "only {begin} entries");
    }
}
