//! Times of repeated runs.

use std::{fs, time::Instant};

use anyhow::Result;

/// Times of some runs, in milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Time of each run.
    pub ms: Vec<f64>,
    /// Processor time per run, over all threads. `None` if the system does not report it.
    pub cpu_ms: Option<f64>,
}

impl Samples {
    /// Runs `run` to warm up and then `n_runs` times. Each run returns its milliseconds.
    pub fn of(n_warm_up: usize, n_runs: usize, mut run: impl FnMut() -> Result<f64>) -> Result<Self> {
        for _ in 0..n_warm_up {
            run()?;
        }
        let before = process_cpu_ms();
        let ms = (0..n_runs).map(|_| run()).collect::<Result<Vec<_>>>()?;
        let cpu_ms = before.zip(process_cpu_ms()).map(|(before, after)| (after - before) / n_runs as f64);
        Ok(Self { ms, cpu_ms })
    }

    /// Runs several functions in turns, so that other work on the machine slows all of them down. Everything
    /// that is compared must be measured so. Each run returns its milliseconds.
    pub fn in_turns(
        n_warm_up: usize,
        n_runs: usize,
        runs: &mut [&mut dyn FnMut() -> Result<f64>],
    ) -> Result<Vec<Self>> {
        let mut all = vec![Self { ms: Vec::new(), cpu_ms: Some(0.0) }; runs.len()];
        for turn in 0..n_warm_up + n_runs {
            for (run, samples) in runs.iter_mut().zip(&mut all) {
                // Warm-up turns are run and dropped here, because a warm-up of each alone would not be in
                // turns.
                let one = Self::of(0, 1, &mut *run)?;
                if turn >= n_warm_up {
                    samples.ms.extend(one.ms);
                    let share = one.cpu_ms.map(|ms| ms / n_runs as f64);
                    samples.cpu_ms = samples.cpu_ms.zip(share).map(|(sum, share)| sum + share);
                }
            }
        }
        Ok(all)
    }

    /// Like [`of`](Self::of), by wall-clock time.
    pub fn wall(n_warm_up: usize, n_runs: usize, mut run: impl FnMut() -> Result<()>) -> Result<Self> {
        Self::of(n_warm_up, n_runs, || wall_ms(&mut run))
    }

    /// The median. For an even number of runs, the mean of the two in the middle.
    pub fn median(&self) -> f64 {
        let mut sorted = self.ms.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        match sorted.len() {
            0 => f64::NAN,
            n if n % 2 == 1 => sorted[middle],
            _ => (sorted[middle - 1] + sorted[middle]) / 2.0,
        }
    }

    /// The fastest run.
    pub fn least(&self) -> f64 {
        self.ms.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The slowest run.
    pub fn most(&self) -> f64 {
        self.ms.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Wall-clock milliseconds that `run` takes.
pub fn wall_ms(mut run: impl FnMut() -> Result<()>) -> Result<f64> {
    let start = Instant::now();
    run()?;
    Ok(start.elapsed().as_secs_f64() * 1e3)
}

/// User and system time of this process, in milliseconds. Linux counts it in ticks of 10 ms.
fn process_cpu_ms() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name, in parentheses, and may hold spaces.
    let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
    // After the name, fields count from the third: user time is the 14th, system time the 15th.
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) * 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_in_the_middle() {
        let samples = |ms: &[f64]| Samples { ms: ms.to_vec(), cpu_ms: None };
        assert_eq!(samples(&[3.0, 1.0, 10.0]).median(), 3.0);
        assert_eq!(samples(&[4.0, 1.0, 10.0, 2.0]).median(), 3.0);
        assert_eq!((samples(&[3.0, 1.0]).least(), samples(&[3.0, 1.0]).most()), (1.0, 3.0));
        assert!(samples(&[]).median().is_nan());
    }

    #[test]
    fn turns_alternate() {
        let order = std::cell::RefCell::new(Vec::new());
        let run = |name: f64| {
            order.borrow_mut().push(name);
            Ok(name)
        };
        let (mut a, mut b) = (|| run(1.0), || Ok(2.0));
        let samples = Samples::in_turns(1, 3, &mut [&mut a, &mut b]).unwrap();
        assert_eq!((&samples[0].ms[..], &samples[1].ms[..]), (&[1.0; 3][..], &[2.0; 3][..]));
        assert_eq!(order.borrow().len(), 4);
    }

    #[test]
    fn warm_up_runs_do_not_count() {
        let mut n = 0.0;
        let samples = Samples::of(2, 3, || {
            n += 1.0;
            Ok(n)
        });
        assert_eq!(samples.unwrap().ms, [3.0, 4.0, 5.0]);
    }
}
