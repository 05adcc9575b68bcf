//! Undo and redo.

use std::collections::VecDeque;

use super::weights::{Edit, Mask};

/// Edits of one mask that can be undone and made again, within a limit on their memory.
#[derive(Clone, Debug)]
pub struct History {
    /// The newest comes last.
    done: VecDeque<Edit>,
    /// The next one to make again comes last.
    undone: Vec<Edit>,
    most_bytes: usize,
}

impl Default for History {
    /// 64 MiB: 28 strokes over all of 300,000 Gaussians, or thousands of small ones.
    fn default() -> Self {
        Self::new(64 << 20)
    }
}

impl History {
    /// An empty history that takes at most `most_bytes`. The newest edit is always kept; it takes at most 8
    /// bytes per Gaussian.
    pub fn new(most_bytes: usize) -> Self {
        Self { done: VecDeque::new(), undone: Vec::new(), most_bytes }
    }

    /// Adds an edit that was just made. Those that were undone are gone, and the oldest go if there is no room.
    /// An edit that changed nothing is not added.
    pub fn push(&mut self, edit: Edit) {
        if edit.is_empty() {
            return;
        }
        self.undone.clear();
        self.done.push_back(edit);
        while self.done.len() > 1 && self.n_bytes() > self.most_bytes {
            self.done.pop_front();
        }
    }

    /// Undoes the newest edit of `mask`, and returns it. `None` if there is none.
    pub fn undo(&mut self, mask: &mut Mask) -> Option<&Edit> {
        let mut edit = self.done.pop_back()?;
        edit.swap(mask);
        self.undone.push(edit);
        self.undone.last()
    }

    /// Makes the edit again that was undone last, and returns it. `None` if there is none.
    pub fn redo(&mut self, mask: &mut Mask) -> Option<&Edit> {
        let mut edit = self.undone.pop()?;
        edit.swap(mask);
        self.done.push_back(edit);
        self.done.back()
    }

    /// The number of edits that can be undone, and of those that can be made again.
    pub fn len(&self) -> (usize, usize) {
        (self.done.len(), self.undone.len())
    }

    /// Whether there is nothing to undo and nothing to make again.
    pub fn is_empty(&self) -> bool {
        self.len() == (0, 0)
    }

    /// Bytes of memory that the edits take.
    pub fn n_bytes(&self) -> usize {
        self.done.iter().chain(&self.undone).map(Edit::n_bytes).sum()
    }
}
