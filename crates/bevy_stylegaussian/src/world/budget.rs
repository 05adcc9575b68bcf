//! The budget of all worlds, and the usual one of a machine.

use bevy::{
    prelude::*,
    render::renderer::{RenderAdapterInfo, RenderDevice},
};
use wgpu::DeviceType;

/// Bytes that a Gaussian takes: 56 in main memory, which are 14 numbers (mean, rotation, scales, opacity and a
/// color); 120.5 on the GPU with paint and one view, whose parts the documentation of `stylegaussian_gpu` has;
/// and half as much again for chunks, and levels that come and go.
const BYTES: u64 = 265;

/// On a card with memory of its own: 0.54 GB of it, an eighth of 4 GB.
const ON_CARD: usize = 3_000_000;

/// Main memory is so many times what worlds take of it, if the GPU has no other. The rest is for everything
/// else.
const SHARE_OF_MEMORY: u64 = 32;

/// Main memory of a machine that does not tell it.
const USUAL_MEMORY: u64 = 8 << 30;

/// The fewest on any GPU: what little memory lets through is still a picture.
const FEWEST: usize = 100_000;

/// On a CPU that draws: time is short there, and memory is not.
const ON_CPU: usize = 250_000;

/// In a browser, whose page has 4 GB at most, and which ends pages earlier on a phone: 0.27 GB of them.
const IN_BROWSER: usize = 1_000_000;

/// Bytes per Gaussian of the largest buffer of a view, half a record. A view cannot show more than fit one
/// binding.
const RECORD_BYTES: u64 = 16;

/// The Gaussians of all [`GaussianWorld`](super::GaussianWorld)s together. Set it at any time.
///
/// All cameras share it: the Gaussians go where they are largest on any screen. While one level takes the place
/// of another, both are in memory.
///
/// An app that inserts none gets the usual one of its machine. That is there from `PreStartup` on, and not yet
/// while plugins are built, because the renderer is not known then. A Gaussian is 265 bytes in all memories:
///
/// | | Gaussians |
/// | --- | --- |
/// | a card with memory of its own | 3 million |
/// | a GPU that shares main memory, or is not known | a 32nd of it (of 8 GB if not told), 3 million at most |
/// | a browser | 1 million |
/// | a CPU that draws | a quarter of a million |
/// | no renderer | 3 million |
///
/// None has more than fit the adapter's largest binding at 16 bytes each. wgpu does not tell how much memory a
/// GPU has, and main memory is told on Linux and Android.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Resource, Clone, Debug, Default, PartialEq)]
pub struct GaussianBudget {
    /// The most Gaussians that are shown.
    pub gaussians: usize,
    /// The most Gaussians of files that are being read at a time. One file is always read, whatever its size.
    pub in_flight: usize,
    /// The most Gaussians that are handed to the GPU in a frame. A part counts as 4096 of them at least. One
    /// part always is, whatever its size. If a style changes, no more are painted at a time.
    pub per_frame: usize,
}

impl GaussianBudget {
    /// A budget of so many Gaussians, of which a third may be in flight, and a twelfth goes to the GPU in a
    /// frame.
    pub const fn new(gaussians: usize) -> Self {
        Self { gaussians, in_flight: gaussians / 3, per_frame: gaussians / 12 }
    }
}

impl Default for GaussianBudget {
    /// That of a card with memory of its own: 3 million Gaussians, a million in flight, and a quarter of a
    /// million in a frame.
    fn default() -> Self {
        Self::new(ON_CARD)
    }
}

/// Facts of a machine that its budget follows from.
#[derive(Clone, Copy, Debug)]
struct Machine {
    device_type: DeviceType,
    /// Bytes of the largest buffer that can be bound.
    largest_binding: u64,
    /// Bytes of main memory, if they are known.
    memory: Option<u64>,
    is_browser: bool,
}

impl Machine {
    fn budget(&self) -> GaussianBudget {
        let gaussians = match self.device_type {
            _ if self.is_browser => IN_BROWSER,
            DeviceType::Cpu => ON_CPU,
            DeviceType::DiscreteGpu => ON_CARD,
            DeviceType::IntegratedGpu | DeviceType::VirtualGpu | DeviceType::Other => {
                let memory = self.memory.unwrap_or(USUAL_MEMORY);
                whole(memory / SHARE_OF_MEMORY / BYTES).clamp(FEWEST, ON_CARD)
            }
        };
        GaussianBudget::new(gaussians.min(whole(self.largest_binding / RECORD_BYTES)))
    }
}

/// Adds to a sum that has a limit, which the first part may exceed. Returns whether it did.
pub(super) fn within((limit, sum): &mut (usize, usize), part: usize) -> bool {
    let fits = *sum == 0 || sum.saturating_add(part) <= *limit;
    if fits {
        *sum = sum.saturating_add(part.max(1));
    }
    fits
}

/// The number as a `usize`, or the largest one if it does not fit.
fn whole(n: u64) -> usize {
    usize::try_from(n).unwrap_or(usize::MAX)
}

/// Gives the app the usual budget of its machine, unless it has one of its own. The renderer must be finished.
pub(super) fn insert_usual_budget(app: &mut App) {
    let world = app.world_mut();
    if world.contains_resource::<GaussianBudget>() {
        return;
    }
    // Bevy puts copies into the main world. They are absent if the app does not render.
    let adapter = world.get_resource::<RenderAdapterInfo>();
    let machine = adapter.zip(world.get_resource::<RenderDevice>()).map(|(adapter, device)| {
        let limits = device.limits();
        Machine {
            device_type: adapter.0.device_type,
            largest_binding: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            memory: main_memory(),
            is_browser: cfg!(target_family = "wasm"),
        }
    });
    let budget = machine.map_or_else(GaussianBudget::default, |machine| machine.budget());
    world.insert_resource(budget);
}

/// Bytes of main memory, if the system tells them.
fn main_memory() -> Option<u64> {
    if !cfg!(any(target_os = "linux", target_os = "android")) {
        return None;
    }
    total_of(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

/// Bytes of main memory by the text of `/proc/meminfo`.
fn total_of(text: &str) -> Option<u64> {
    let total = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    total.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};

    use super::*;
    use crate::tests::world::app_without_rendering;

    #[test]
    fn budgets_follow_the_machine() {
        let gib = |n: u64| Some(n << 30);
        let of = |device_type, memory, is_browser, largest_binding| {
            Machine { device_type, largest_binding, memory, is_browser }.budget().gaussians
        };
        let usual = 128 << 20;
        assert_eq!(of(DiscreteGpu, gib(8), false, usual), 3_000_000);
        // 2^33 bytes / 32 / 265.
        for device in [IntegratedGpu, VirtualGpu, Other] {
            assert_eq!(of(device, gib(8), false, usual), 1_012_963);
            assert_eq!(of(device, None, false, usual), 1_012_963);
        }
        assert_eq!(of(IntegratedGpu, gib(16), false, usual), 2_025_927);
        assert_eq!(of(IntegratedGpu, gib(64), false, usual), 3_000_000);
        assert_eq!(of(IntegratedGpu, Some(1 << 20), false, usual), 100_000);
        assert_eq!(of(Cpu, gib(64), false, usual), 250_000);
        for device in [Other, Cpu, DiscreteGpu] {
            assert_eq!(of(device, None, true, usual), 1_000_000);
        }
        // 16 bytes each.
        assert_eq!(of(DiscreteGpu, None, false, 16 << 20), 1 << 20);
        let GaussianBudget { gaussians, in_flight, per_frame } = GaussianBudget::default();
        assert_eq!((gaussians, in_flight, per_frame), (3_000_000, 1_000_000, 250_000));
    }

    #[test]
    fn a_limit_lets_one_part_pass() {
        let mut sum = (10, 0);
        assert!(within(&mut sum, 25) && !within(&mut sum, 1));
        let mut sum = (10, 0);
        assert!(within(&mut sum, 6) && within(&mut sum, 4) && !within(&mut sum, 1));
        // One without Gaussians counts too.
        assert!(within(&mut (0, 0), 0));
    }

    #[test]
    fn main_memory_is_that_of_the_system() {
        let text = "MemTotal:       24598212 kB\nMemFree:        11111111 kB\n";
        assert_eq!(total_of(text), Some(24_598_212 * 1024));
        for text in
            ["", "MemTotal:", "MemTotal: 12 MB", "MemTotal: -1 kB", "MemTotal: 18446744073709551615 kB"]
        {
            assert_eq!(total_of(text), None, "{text}");
        }
        assert_eq!(main_memory().is_some(), cfg!(any(target_os = "linux", target_os = "android")));
    }

    #[test]
    fn an_app_keeps_its_own_budget() {
        let budget_of = |own: Option<GaussianBudget>| {
            let mut app = App::new();
            if let Some(own) = own {
                app.insert_resource(own);
            }
            insert_usual_budget(&mut app);
            *app.world().resource::<GaussianBudget>()
        };
        assert_eq!(budget_of(None), GaussianBudget::default());
        assert_eq!(budget_of(Some(GaussianBudget::new(7))), GaussianBudget::new(7));
    }

    #[test]
    fn systems_find_a_budget_from_the_first_one_on() {
        let mut app = app_without_rendering();
        app.add_systems(PreStartup, |mut budget: ResMut<GaussianBudget>| budget.in_flight = 7);
        app.update();
        let changed = GaussianBudget { in_flight: 7, ..GaussianBudget::default() };
        assert_eq!(*app.world().resource::<GaussianBudget>(), changed);
    }
}
