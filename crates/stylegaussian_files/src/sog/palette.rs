//! Choosing the palette of spherical harmonics for a scene: vector quantization by a tree.
//!
//! The coefficients above degree 0 of each Gaussian are a row. All rows are one cell, which is halved along
//! its principal axis at the mean, and so on, until there are as many cells as entries; an entry is the mean of
//! a cell. Halves get entries in proportion to their squared errors, because the cells of the best palette
//! contribute equally to the error (Gersho, "Asymptotically optimal block quantization", 1979). That takes
//! N log(entries) comparisons of rows, where one round of k-means takes N times the number of entries.

use rayon::prelude::*;
use stylegaussian::{scene::Sh, sh};

/// Most entries: labels have 16 bits.
pub(super) const MOST: usize = 1 << 16;

/// Rounds of power iteration: for half of the variance along the principal axis and a quarter along the next
/// one, the part of the latter is an eighth after three.
const ROUNDS: usize = 3;

/// Halvings at the mean before halves become equally large. Rows that grow like powers would be split off one
/// by one, and 2^32 rows have a depth of 32.
const DEEP: usize = 32;

/// Coefficients above degree 0 that stand for those of several Gaussians each.
pub(super) struct Entries {
    /// `[entries, (degree + 1)^2 - 1, 3]`, RGB innermost.
    pub values: Vec<f32>,
    /// The entry of each Gaussian `[N]`.
    pub labels: Vec<u16>,
}

impl Entries {
    /// At most `most` entries, [`MOST`] at the most, for coefficients of degree 1 or above. Equal rows have one
    /// entry. It is the same for any number of threads.
    pub fn new(sh: &Sh, most: usize) -> Self {
        let rows = Rows { coefficients: &sh.coefficients, width: 3 * sh::n_coefficients(sh.degree) };
        let mut members: Vec<u32> = (0..rows.len() as u32).collect();
        let cell = Cell { spread: rows.spread(&members), n: most.min(MOST), depth: 0 };
        let cells = rows.cells(&mut members, cell);
        let mut labels = vec![0; members.len()];
        let mut rest = &members[..];
        for (entry, &size) in cells.sizes.iter().enumerate() {
            let (of_entry, others) = rest.split_at(size);
            of_entry.iter().for_each(|&i| labels[i as usize] = entry as u16);
            rest = others;
        }
        Self { values: cells.means, labels }
    }
}

/// The coefficients of all Gaussians.
struct Rows<'a> {
    coefficients: &'a [f32],
    /// Coefficients of a Gaussian, degree 0 included.
    width: usize,
}

/// The mean of some rows `[width - 3]`, and the sums of squared distances to it, value by value.
struct Spread {
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Spread {
    /// The squared error of the mean in the rows' stead.
    fn error(&self) -> f64 {
        self.squares.iter().sum()
    }
}

/// Rows that are to have at most `n` entries.
struct Cell {
    spread: Spread,
    n: usize,
    /// Number of halvings before.
    depth: usize,
}

/// Cells of rows that follow one another.
struct Cells {
    /// Rows of each.
    sizes: Vec<usize>,
    /// The mean of each.
    means: Vec<f32>,
}

impl Rows<'_> {
    fn len(&self) -> usize {
        self.coefficients.len() / self.width
    }

    /// The coefficients of Gaussian `i` above degree 0.
    fn row(&self, i: u32) -> &[f32] {
        &self.coefficients[i as usize * self.width..][3..self.width]
    }

    /// Row `i`, less the mean.
    fn steps(&self, i: u32, mean: &[f64]) -> impl Iterator<Item = f64> {
        self.row(i).iter().zip(mean).map(|(value, mean)| f64::from(*value) - mean)
    }

    fn spread(&self, members: &[u32]) -> Spread {
        let mut mean = vec![0.0; self.width - 3];
        for &i in members {
            mean.iter_mut().zip(self.row(i)).for_each(|(sum, value)| *sum += f64::from(*value));
        }
        mean.iter_mut().for_each(|sum| *sum /= members.len() as f64);
        let mut squares = vec![0.0; self.width - 3];
        for &i in members {
            squares.iter_mut().zip(self.steps(i, &mean)).for_each(|(sum, step)| *sum += step * step);
        }
        Spread { mean, squares }
    }

    /// The component of row `i`, less the mean, along an axis.
    fn along(&self, i: u32, mean: &[f64], axis: &[f64]) -> f64 {
        self.steps(i, mean).zip(axis).map(|(step, axis)| step * axis).sum()
    }

    /// The unit vector along which rows differ most, by power iteration from the value that differs most.
    fn axis(&self, members: &[u32], spread: &Spread) -> Vec<f64> {
        let Spread { mean, squares } = spread;
        let widest = (0..squares.len()).max_by(|&a, &b| squares[a].total_cmp(&squares[b]));
        let mut axis = vec![0.0; mean.len()];
        widest.into_iter().for_each(|widest| axis[widest] = 1.0);
        for _ in 0..ROUNDS {
            let mut next = vec![0.0; mean.len()];
            for &i in members {
                let along = self.along(i, mean, &axis);
                next.iter_mut().zip(self.steps(i, mean)).for_each(|(sum, step)| *sum += along * step);
            }
            let length = next.iter().map(|value| value * value).sum::<f64>().sqrt();
            if !(length.is_finite() && length > 0.0) {
                break;
            }
            next.iter_mut().for_each(|value| *value /= length);
            axis = next;
        }
        axis
    }

    /// Sorts `members` into cells.
    fn cells(&self, members: &mut [u32], cell: Cell) -> Cells {
        let Cell { spread, n, depth } = cell;
        let n = n.min(members.len());
        // Equal rows have no error, and rows that are not finite have none that is above 0.
        let error = spread.error();
        if n < 2 || error.is_nan() || error <= 0.0 {
            let means = spread.mean.iter().map(|value| *value as f32).collect();
            return Cells { sizes: vec![members.len()], means };
        }
        let axis = self.axis(members, &spread);
        let place = |&i: &u32| (self.along(i, &spread.mean, &axis), i);
        let mut places: Vec<(f64, u32)> = members.par_iter().map(place).collect();
        let below = places.iter().filter(|(along, _)| *along < 0.0).count();
        let is_usual = depth < DEEP && (1..places.len()).contains(&below);
        let at = if is_usual { below } else { places.len() / 2 };
        places.select_nth_unstable_by(at, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // The halves are sets that do not depend on how they were searched for, but sums depend on the order.
        places[..at].sort_unstable_by_key(|&(_, i)| i);
        places[at..].sort_unstable_by_key(|&(_, i)| i);
        members.iter_mut().zip(&places).for_each(|(member, &(_, i))| *member = i);
        drop(places);
        let (first, second) = members.split_at_mut(at);
        let (a, b) = rayon::join(|| self.spread(first), || self.spread(second));
        let share = a.error() / (a.error() + b.error());
        // The cast makes 0 of NaN, which two halves without errors give. Neither gets more than it has rows.
        let of_first = (share * n as f64).round() as usize;
        let most = first.len().min(n - 1);
        let of_first = of_first.max(n.saturating_sub(second.len())).clamp(1, most);
        let of_second = Cell { spread: b, n: n - of_first, depth: depth + 1 };
        let of_first = Cell { spread: a, n: of_first, depth: depth + 1 };
        let (mut cells, others) =
            rayon::join(|| self.cells(first, of_first), || self.cells(second, of_second));
        cells.sizes.extend(others.sizes);
        cells.means.extend(others.means);
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of degree 1 whose rows above degree 0 are these numbers, nine times each.
    fn of(numbers: &[f32]) -> Sh {
        let row = |number: &f32| [[7.0; 3], [*number; 3], [*number; 3], [*number; 3]].concat();
        Sh { degree: 1, coefficients: numbers.iter().flat_map(row).collect() }
    }

    /// The numbers that the entries give in their stead.
    fn rounded(entries: &Entries) -> Vec<f32> {
        entries.labels.iter().map(|&label| entries.values[9 * usize::from(label)]).collect()
    }

    #[test]
    fn equal_rows_share_an_entry_and_few_rows_have_their_own() {
        let numbers = [3.0, -1.0, 3.0, 0.5, 0.5, -1.0, 1e-20];
        let entries = Entries::new(&of(&numbers), MOST);
        assert_eq!(rounded(&entries), numbers);
        assert_eq!(entries.values.len(), 9 * 4, "four numbers differ");
        assert_eq!(Entries::new(&of(&[0.0; 100]), MOST).values, [0.0; 9]);
        assert_eq!(Entries::new(&of(&numbers), 1).values.len(), 9);
    }

    #[test]
    fn entries_go_where_the_errors_are() {
        // A crowd within 0.001, and another that is spread over 100: the mean is between them.
        let crowd = |i: usize| if i < 500 { -100.0 + i as f32 * 2e-6 } else { i as f32 / 10.0 };
        let numbers: Vec<f32> = (0..1000).map(crowd).collect();
        let entries = Entries::new(&of(&numbers), 32);
        assert!((16..=32).contains(&(entries.values.len() / 9)), "{}", entries.values.len() / 9);
        let found = rounded(&entries);
        // 31 even cells of 50 units are 1.6 wide, and mean splits are within a factor of two of them.
        let most = found.iter().zip(&numbers).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(most < 2.0, "{most}");
        let of_crowd: std::collections::BTreeSet<u16> = entries.labels[..500].iter().copied().collect();
        assert_eq!(of_crowd.len(), 1);
    }

    #[test]
    fn rows_that_grow_like_powers_end() {
        let numbers: Vec<f32> = (0..3000).map(|i| 2_f32.powi(i % 240 - 120)).collect();
        let entries = Entries::new(&of(&numbers), MOST);
        let most =
            rounded(&entries).iter().zip(&numbers).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f32::max);
        assert!(most < 1e-6, "{most}");
        // Nothing that a caller may hand over ends in a panic.
        let odd = of(&[f32::NAN, 1.0, f32::INFINITY, 2.0]);
        assert_eq!(Entries::new(&odd, MOST).labels.len(), 4);
        assert!(Entries::new(&of(&[]), MOST).labels.is_empty());
    }
}
