//! The weights, and changes of them that can be undone.

use std::ops::Range;

use rayon::prelude::*;

/// Channels of a mask.
pub const CHANNELS: usize = 4;

/// Gaussians that one task changes: far more work than starting a task takes.
const PER_TASK: usize = 8192;

/// Painted weights of N Gaussians in four channels: 0 is none, 255 is all.
///
/// A channel beyond the fourth is no error anywhere: painting it changes nothing, and it reads as 0.
#[derive(Clone, Debug, Default)]
pub struct Mask {
    /// The weights `[N]`, in the order of the scene in memory.
    pub weights: Vec<[u8; CHANNELS]>,
    /// Names of the channels, for people.
    pub names: [String; CHANNELS],
    /// Dabs so far. Their rounding must differ, or faint ones would never add up.
    pub(super) n_dabs: u64,
}

impl Mask {
    /// A mask of `n` Gaussians of which none is painted.
    pub fn new(n: usize) -> Self {
        Self { weights: vec![[0; CHANNELS]; n], ..Self::default() }
    }

    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// The weight of Gaussian `i` in `channel`, 0..1.
    ///
    /// # Panics
    /// If `i` is not below N.
    pub fn weight(&self, i: usize, channel: usize) -> f32 {
        share(self.weights[i], channel)
    }

    /// The mask of the Gaussians at `indices`, in that order.
    pub(crate) fn subset(&self, indices: &[u32]) -> Self {
        let weights = indices.iter().map(|&i| self.weights[i as usize]).collect();
        Self { weights, names: self.names.clone(), n_dabs: self.n_dabs }
    }

    /// Replaces the weights of each Gaussian by those that `changed` gives for its index and its former
    /// weights.
    pub(super) fn edit(&mut self, changed: impl Fn(usize, [u8; CHANNELS]) -> [u8; CHANNELS] + Sync) -> Edit {
        let of_task = |(task, weights): (usize, &mut [[u8; CHANNELS]])| {
            let mut former = Vec::new();
            for (i, weights) in (PER_TASK * task..).zip(weights) {
                let new = changed(i, *weights);
                if new != *weights {
                    former.push((i as u32, std::mem::replace(weights, new)));
                }
            }
            former
        };
        let former: Vec<_> = self.weights.par_chunks_mut(PER_TASK).enumerate().map(of_task).collect();
        Edit { former: former.concat() }
    }
}

/// The weight in `channel`, 0..1; 0 if there is no such channel.
pub(super) fn share(weights: [u8; CHANNELS], channel: usize) -> f32 {
    weights.get(channel).map_or(0.0, |&weight| f32::from(weight) / 255.0)
}

/// A change of a mask: the Gaussians that it changed, 8 bytes for each, and the weights that they do not have
/// now.
#[derive(Clone, Debug, Default)]
pub struct Edit {
    /// Index and weights, by ascending index.
    former: Vec<(u32, [u8; CHANNELS])>,
}

impl Edit {
    /// The number of Gaussians that it changed.
    pub fn len(&self) -> usize {
        self.former.len()
    }

    /// Whether it changed nothing.
    pub fn is_empty(&self) -> bool {
        self.former.is_empty()
    }

    /// Bytes of memory.
    pub fn n_bytes(&self) -> usize {
        self.former.capacity() * size_of::<(u32, [u8; CHANNELS])>()
    }

    /// Undoes the change in the mask that it was made in, or makes it again if it is undone. Edits of one mask
    /// must be undone in reverse order. Gaussians that `mask` does not have are passed over.
    pub fn swap(&mut self, mask: &mut Mask) {
        for (i, weights) in &mut self.former {
            if let Some(now) = mask.weights.get_mut(*i as usize) {
                std::mem::swap(weights, now);
            }
        }
    }

    /// Adds a later edit's changes of Gaussians that are not `touched` yet, and touches them. To be sorted in
    /// the end.
    pub(super) fn append(&mut self, later: &Self, touched: &mut [bool]) {
        let is_new = |&&(i, _): &&(u32, [u8; CHANNELS])| !std::mem::replace(&mut touched[i as usize], true);
        self.former.extend(later.former.iter().filter(is_new));
    }

    /// Restores the order by index.
    pub(super) fn sort(&mut self) {
        self.former.sort_unstable_by_key(|&(i, _)| i);
    }

    /// The indices that it changed, as ranges by ascending index. Ranges less than `gap` apart are one, and if
    /// there are more than `most` of them, all are one.
    pub fn ranges(&self, gap: usize, most: usize) -> Vec<Range<usize>> {
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for i in self.former.iter().map(|&(i, _)| i as usize) {
            match ranges.last_mut() {
                Some(last) if i < last.end + gap.max(1) => last.end = i + 1,
                _ => ranges.push(i..i + 1),
            }
        }
        let end = ranges.last().map_or(0, |last| last.end);
        if ranges.len() > most {
            ranges.truncate(1);
            ranges.iter_mut().for_each(|all| all.end = end);
        }
        ranges
    }
}
