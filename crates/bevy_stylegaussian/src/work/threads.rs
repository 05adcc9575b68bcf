//! The threads of the lanes.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex},
};

use bevy::{log::error, tasks::AsyncComputeTaskPool};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::{Job, Lane, StyleThreads, unpoisoned};

/// The lanes, and the settings of their threads.
#[derive(Default)]
pub(super) struct Lanes {
    settings: Mutex<StyleThreads>,
    /// By [`Lane`].
    lanes: [Mutex<Queue>; Lane::COUNT],
}

/// The computations of a lane.
#[derive(Default)]
struct Queue {
    jobs: VecDeque<Job>,
    /// Whether one of the threads takes jobs from the queue. Never two: while a job waits for the other threads
    /// of its pool, its thread may do what it finds there, which must not be another job.
    is_running: bool,
    /// The threads, and the settings by which they were started.
    pool: Option<(StyleThreads, Arc<ThreadPool>)>,
}

impl Lane {
    /// Number of lanes.
    const COUNT: usize = 4;

    /// Name of its threads.
    fn name(self) -> &'static str {
        match self {
            Self::Scenes => "scenes",
            Self::Styles => "styles",
            Self::Bakes => "bakes",
            Self::Short => "short",
        }
    }
}

impl Lanes {
    /// Has further threads started by these settings.
    pub(super) fn set(&self, threads: StyleThreads) {
        *unpoisoned(&self.settings) = threads;
    }

    /// Does a job after all that are in its lane.
    pub(super) fn queue(self: &Arc<Self>, lane: Lane, job: Job) {
        let threads = *unpoisoned(&self.settings);
        let mut queue = unpoisoned(&self.lanes[lane as usize]);
        queue.jobs.push_back(job);
        if queue.is_running {
            return;
        }
        match queue.pool(threads, lane) {
            Ok(pool) => {
                queue.is_running = true;
                let lanes = Arc::clone(self);
                pool.spawn(move || lanes.drain(lane));
            }
            Err(error) => {
                error!("no thread can be started, so a task of Bevy computes: {error}");
                let jobs = std::mem::take(&mut queue.jobs);
                AsyncComputeTaskPool::get()
                    .spawn(async move { jobs.into_iter().for_each(|job| job()) })
                    .detach();
            }
        }
    }

    /// Does what is in the queue.
    fn drain(&self, lane: Lane) {
        loop {
            let mut queue = unpoisoned(&self.lanes[lane as usize]);
            let Some(job) = queue.jobs.pop_front() else {
                queue.is_running = false;
                return;
            };
            drop(queue);
            job();
        }
    }
}

impl Queue {
    /// The threads of the lane, started if there are none by these settings.
    fn pool(
        &mut self,
        threads: StyleThreads,
        lane: Lane,
    ) -> Result<Arc<ThreadPool>, rayon::ThreadPoolBuildError> {
        if let Some((_, pool)) = self.pool.as_ref().filter(|(of, _)| *of == threads) {
            return Ok(Arc::clone(pool));
        }
        let name = lane.name();
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads.count.max(1))
            .thread_name(move |index| format!("{name} {index}"))
            .start_handler(move |_| set_priority(threads.priority))
            .build()?;
        let pool = Arc::new(pool);
        self.pool = Some((threads, Arc::clone(&pool)));
        Ok(pool)
    }
}

/// Gives this thread a priority, if the system allows it.
fn set_priority(priority: u8) {
    use thread_priority::{ThreadPriority, ThreadPriorityValue, set_current_thread_priority};

    if let Ok(priority) = ThreadPriorityValue::try_from(priority.min(99)) {
        let _ = set_current_thread_priority(ThreadPriority::Crossplatform(priority));
    }
}
