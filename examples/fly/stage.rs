//! An app without a window, whose frames are measured and read back.

use std::{
    collections::HashSet,
    fs,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use bevy::{
    app::PluginsState,
    asset::UnapprovedPathMode,
    camera::RenderTarget,
    core_pipeline::tonemapping::Tonemapping,
    ecs::schedule::SingleThreadedExecutor,
    prelude::*,
    render::{
        RenderApp,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_asset::RenderAssets,
        render_resource::{
            BufferDescriptor, BufferUsages, CommandEncoderDescriptor, MapMode, PollType, TexelCopyBufferInfo,
            TexelCopyBufferLayout, TextureFormat, TextureUsages,
        },
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_stylegaussian::{prelude::*, stylegaussian::Scene};

use super::figures::Picture;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// The game's time from frame to frame, on any machine.
const FRAME: Duration = Duration::from_nanos(1_000_000_000 / 30);

/// The longest wait for anything: thousands of parts may have to be painted.
pub const LIMIT: Duration = Duration::from_secs(3600);

/// The app, and what it draws.
pub struct Stage {
    pub app: App,
    /// Files of worlds that could not be had.
    pub failed: Vec<String>,
    camera: Entity,
    target: Handle<Image>,
    size: UVec2,
}

/// Times of a frame, in milliseconds.
#[derive(Clone, Copy, Default)]
pub struct Times {
    /// From its begin until the GPU has drawn it.
    pub wall: f64,
    /// In the main world's schedule alone, by the clock that was asked for.
    pub main: f64,
}

/// The main world's time in a frame.
#[derive(Resource)]
struct MainClock {
    clock: Clock,
    begun: Duration,
    took: Duration,
}

/// A clock for the main world's time.
#[derive(Clone, Copy)]
pub enum Clock {
    /// Time since a moment, waiting for a core included.
    Wall(Instant),
    /// CPU time of the main thread, which then runs all systems.
    MainThread,
}

/// The scene can be drawn.
#[derive(Component)]
struct Ready;

/// Runs of a world that are drawn, or would be from another side.
#[derive(Default)]
pub struct Runs {
    pub shown: HashSet<Entity>,
    /// Those that the camera sees without paint.
    pub n_unpainted: usize,
}

impl Stage {
    /// An app with a camera that draws `size` pixels.
    ///
    /// # Errors
    /// If the operating system does not tell the time that is asked for.
    pub fn new(size: UVec2, lens: PerspectiveProjection, clock: Clock) -> Result<Self> {
        ensure!(clock.time().is_some(), "found no CPU time of a thread, which Linux alone tells");
        let window =
            WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
        // The world's folder may lie anywhere.
        let files = AssetPlugin {
            file_path: ASSETS.into(),
            unapproved_path_mode: UnapprovedPathMode::Allow,
            ..default()
        };
        let mut app = App::new();
        // Without pipelined rendering, an update draws its own frame.
        let plugins = DefaultPlugins.set(window).set(files).disable::<WinitPlugin>();
        app.add_plugins((plugins.disable::<PipelinedRenderingPlugin>(), StyleGaussianPlugin::default()));
        app.insert_resource(TimeUpdateStrategy::ManualDuration(FRAME));
        app.insert_resource(MainClock { clock, begun: Duration::ZERO, took: Duration::ZERO });
        app.add_systems(First, |mut main: ResMut<MainClock>| {
            main.begun = main.clock.time().unwrap_or_default()
        });
        app.add_systems(Last, |mut main: ResMut<MainClock>| {
            main.took = main.clock.time().unwrap_or_default().saturating_sub(main.begun);
        });
        if matches!(clock, Clock::MainThread) {
            run_on_main_thread(&mut app);
        }
        // The renderer is created asynchronously. A runner would wait for it like this.
        while app.plugins_state() == PluginsState::Adding {
            bevy::tasks::tick_global_task_pools_on_main_thread();
        }
        app.finish();
        app.cleanup();
        let mut target = Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
        target.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
        // Where nothing is drawn, pictures are transparent.
        let camera = Camera { clear_color: Color::NONE.into(), ..default() };
        let film = (RenderTarget::from(target.clone()), Projection::from(lens));
        let camera = (Camera3d::default(), camera, film, Msaa::Off, Tonemapping::None);
        let camera = app.world_mut().spawn(camera).id();
        Ok(Self { app, failed: Vec::new(), camera, target, size })
    }

    /// Moves the camera.
    pub fn move_to(&mut self, pose: Transform) {
        self.app.world_mut().entity_mut(self.camera).insert(pose);
    }

    /// Draws a frame, and waits until the GPU is done.
    pub fn step(&mut self) -> Result<Times> {
        let begun = Instant::now();
        self.app.update();
        self.wait()?;
        let wall = begun.elapsed();
        let world = self.app.world_mut();
        if let Some(failed) = world.resource_mut::<Messages<GaussianSceneFailed>>().drain().next() {
            bail!("{}", failed.error);
        } else if let Some(failed) = world.resource_mut::<Messages<StyleFailed>>().drain().next() {
            bail!("{}", failed.error);
        }
        let mut failed = world.resource_mut::<Messages<GaussianWorldFailed>>();
        self.failed.extend(failed.drain().map(|failed| failed.error));
        let main = world.resource::<MainClock>().took;
        // Bevy answers a render error by an exit, which only a runner would act on.
        if let Some(exit) = self.app.should_exit() {
            bail!("the renderer gave up: {exit:?}");
        }
        Ok(Times { wall: milliseconds(wall), main: milliseconds(main) })
    }

    /// Draws frames until `done`.
    pub fn until(&mut self, what: &str, mut done: impl FnMut(&mut World) -> bool) -> Result<()> {
        let begun = Instant::now();
        while !done(self.app.world_mut()) {
            ensure!(begun.elapsed() < LIMIT, "not within {} s: {what}", LIMIT.as_secs());
            self.step()?;
        }
        Ok(())
    }

    /// Shows a scene, once it can be drawn.
    pub fn show(&mut self, scene: Scene, place: Transform) -> Result<Entity> {
        let world = self.app.world_mut();
        let scene = world.resource_mut::<Assets<GaussianScene>>().add(GaussianScene::new(scene));
        let mut entity = world.spawn((GaussianSplats(scene), place));
        entity.observe(|ready: On<GaussianSceneReady>, mut commands: Commands| {
            commands.entity(ready.entity).try_insert(Ready);
        });
        let entity = entity.id();
        self.until("a scene on the GPU", |world| world.get::<Ready>(entity).is_some())?;
        Ok(entity)
    }

    /// The picture from a place, of something that does not change.
    pub fn picture_from(&mut self, pose: Transform) -> Result<Picture> {
        self.move_to(pose);
        // The first one begins what the second one draws.
        self.step()?;
        self.step()?;
        self.picture()
    }

    /// The last frame.
    pub fn picture(&self) -> Result<Picture> {
        let world = self.app.sub_app(RenderApp).world();
        let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
        let gpu = world.resource::<RenderAssets<GpuImage>>().get(&self.target);
        let gpu = gpu.context("the picture is not on the GPU")?;
        // wgpu copies textures to rows of a multiple of 256 bytes (`COPY_BYTES_PER_ROW_ALIGNMENT`).
        let row = (self.size.x * 4).next_multiple_of(256);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some("picture"),
            size: u64::from(row * self.size.y),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let destination = TexelCopyBufferInfo { buffer: &buffer, layout };
        let extent = gpu.texture_descriptor.size;
        encoder.copy_texture_to_buffer(gpu.texture.as_image_copy(), destination, extent);
        queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(MapMode::Read, |_| ());
        self.wait()?;
        let bytes = buffer.slice(..).get_mapped_range();
        let texels = bytes.chunks_exact(row as usize);
        Ok(texels.flat_map(|row| row.as_chunks::<4>().0[..self.size.x as usize].to_vec()).collect())
    }

    /// Bytes of buffers and textures on the GPU, or `None` if the device does not count them.
    pub fn gpu_bytes(&self) -> Option<u64> {
        let device = self.app.sub_app(RenderApp).world().resource::<RenderDevice>();
        let counters = device.wgpu_device().get_internal_counters().hal;
        let bytes = counters.buffer_memory.read() + counters.texture_memory.read();
        u64::try_from(bytes).ok().filter(|bytes| *bytes > 0)
    }

    /// The runs of a world.
    pub fn runs(&mut self, world: Entity) -> Runs {
        let app = self.app.world_mut();
        type Run =
            (Entity, &'static ChildOf, &'static Visibility, &'static ViewVisibility, Has<AppliedStyle>);
        let mut query = app.query_filtered::<Run, With<GaussianSplats>>();
        let mut runs = Runs::default();
        for (run, parent, visibility, seen, is_painted) in query.iter(app) {
            if parent.parent() == world && *visibility != Visibility::Hidden {
                runs.shown.insert(run);
                runs.n_unpainted += usize::from(seen.get() && !is_painted);
            }
        }
        runs
    }

    /// The Gaussians that a world shows, as one scene.
    pub fn gathered(&mut self, world: Entity) -> Scene {
        let mut shown: Vec<Entity> = self.runs(world).shown.into_iter().collect();
        shown.sort_unstable();
        let app = self.app.world();
        let scenes = app.resource::<Assets<GaussianScene>>();
        let scene = |run: &Entity| Some(scenes.get(&app.get::<GaussianSplats>(*run)?.0)?.scene());
        let mut all = Scene::default();
        shown.iter().filter_map(scene).for_each(|scene| all.append(scene));
        all
    }

    /// Waits until the GPU is done.
    fn wait(&self) -> Result<()> {
        let device = self.app.sub_app(RenderApp).world().resource::<RenderDevice>();
        let done = device.poll(PollType::wait_indefinitely());
        done.map_err(|error| anyhow!("the GPU does not answer: {error:?}")).map(drop)
    }
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

impl Clock {
    /// The present time, or `None` if the operating system does not tell it.
    fn time(self) -> Option<Duration> {
        match self {
            Self::Wall(start) => Some(start.elapsed()),
            Self::MainThread => {
                // Its first number is the time on a core, in nanoseconds.
                let times = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
                times.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
            }
        }
    }
}

/// Has the main world's systems run one after another.
fn run_on_main_thread(app: &mut App) {
    fn alone(schedule: &mut Schedule) {
        schedule.set_executor(SingleThreadedExecutor::new());
    }
    app.edit_schedule(First, alone).edit_schedule(PreUpdate, alone).edit_schedule(Update, alone);
    app.edit_schedule(SpawnScene, alone).edit_schedule(PostUpdate, alone).edit_schedule(Last, alone);
}

/// Bytes of this process's memory by their name in Linux's `/proc/self/status`, or `None` elsewhere.
pub fn memory(name: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(1024 * line.split_whitespace().next()?.parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_sleeps_takes_no_time_of_a_core() {
        let clocks = [Clock::Wall(Instant::now()), Clock::MainThread];
        let before = clocks.map(Clock::time);
        std::thread::sleep(Duration::from_millis(50));
        let [wall, thread] = [0, 1].map(|i| Some(clocks[i].time()? - before[i]?));
        assert!(wall.is_some_and(|wall| wall >= Duration::from_millis(50)));
        assert_eq!(thread.is_some(), cfg!(target_os = "linux"));
        assert!(thread.is_none_or(|thread| thread < Duration::from_millis(25)), "{thread:?}");
    }

    #[test]
    fn memory_is_told_on_linux() {
        let (now, most) = (memory("VmRSS"), memory("VmHWM"));
        assert_eq!(now.is_some(), cfg!(target_os = "linux"));
        assert!(now.is_none_or(|now| now > 1 << 20) && most.is_none_or(|most| most > 1 << 20));
        assert_eq!(memory("no such name"), None);
    }
}
