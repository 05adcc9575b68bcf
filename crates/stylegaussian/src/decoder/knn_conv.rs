//! The KNN convolution, y_p = sum_k W_k x_{n(p,k)} + B, and its gradients.
//!
//! Place k of a neighborhood is called *slot* k: W_k applies to the neighbor in it.
//!
//! Output rows are processed in blocks of `BLOCK_ROWS`. For a few slots at a time, the block's neighbors are
//! gathered into a scratch matrix that stays in a core's L2 cache, and one SIMD product accumulates into the
//! block's output.
//!
//! All three kernels are products of the same size, 2 N K D_in D_out operations. None needs an atomic, and each
//! result is the same for any number of threads.

use rayon::prelude::*;

use super::product::{Matrix, product};
use crate::work::Work;

/// Rows gathered at a time. 512 rows of 256 f32 are 512 KiB, a quarter of a server core's L2 cache and half of
/// a desktop's. The weights are packed anew for each block, which costs 1/512 of the product's operations.
const BLOCK_ROWS: usize = 512;

/// Most channels of the slots that are gathered together. Narrow slots are joined, since a product with an
/// inner dimension of 32 spends its time on loading and storing the output.
const GROUP_WIDTH: usize = 256;

/// The shape of a KNN convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnnConvShape {
    /// K, the number of neighbors of each output row.
    pub k: usize,
    /// D_in, the number of channels of each input row.
    pub d_in: usize,
    /// D_out, the number of channels of each output row.
    pub d_out: usize,
}

impl KnnConvShape {
    /// Checks the lengths of slices that every kernel takes.
    fn check(&self, x: &[f32], neighbors: &[u32], weight: &[f32]) {
        let n_weights = [self.d_out, self.k, self.d_in].into_iter().try_fold(1, usize::checked_mul);
        assert_eq!(Some(weight.len()), n_weights, "weight [D_out, K, D_in]");
        assert!(self.d_in > 0 && x.len().is_multiple_of(self.d_in), "x [N_in, D_in]");
        assert!(self.k > 0 && neighbors.len().is_multiple_of(self.k), "neighbors [N_out, K]");
    }
}

/// Fills `target` with the given rows of x `[N, D_in]`.
fn gather(target: &mut Vec<f32>, x: &[f32], d_in: usize, rows: impl Iterator<Item = u32>) {
    target.clear();
    let mut rows = rows.map(|row| row as usize).peekable();
    while let Some(first) = rows.next() {
        // Rows that follow one another, as in a line of a picture's window, are one copy.
        let mut end = first + 1;
        while rows.next_if_eq(&end).is_some() {
            end += 1;
        }
        target.extend_from_slice(&x[first * d_in..end * d_in]);
    }
}

/// The transpose `[K * D_in, D_out]` of a weight `[D_out, K * D_in]`.
///
/// The weight is the right side of a product, which gemm packs for each block of rows. Transposed once, it lies
/// in the order in which it is packed.
fn transpose(weight: &[f32], d_out: usize) -> Vec<f32> {
    let width = weight.len() / d_out;
    let mut transposed = vec![0.0; weight.len()];
    for (column, target) in transposed.chunks_exact_mut(d_out).enumerate() {
        target.iter_mut().zip(weight[column..].iter().step_by(width)).for_each(|(to, from)| *to = *from);
    }
    transposed
}

/// The KNN convolution y `[N_out, D_out]` of x `[N_in, D_in]` with neighbors `[N_out, K]` (rows of x), weight
/// `[D_out, K, D_in]` and bias `[D_out]`.
///
/// `finish` is applied to each finished block of y, some of its rows, while the block is still in the cache.
///
/// # Panics
/// If a slice does not have the stated shape or a neighbor is not a row of x.
pub fn knn_conv(
    shape: KnnConvShape,
    x: &[f32],
    neighbors: &[u32],
    weight: &[f32],
    bias: &[f32],
    finish: impl Fn(&mut [f32]) + Sync,
) -> Vec<f32> {
    knn_conv_if_wanted(shape, [x, weight, bias], neighbors, finish, &Work::default())
}

/// As [`knn_conv`] of x, weight and bias. If `work` is canceled, blocks of y are left out.
pub(super) fn knn_conv_if_wanted(
    shape: KnnConvShape,
    [x, weight, bias]: [&[f32]; 3],
    neighbors: &[u32],
    finish: impl Fn(&mut [f32]) + Sync,
    work: &Work,
) -> Vec<f32> {
    shape.check(x, neighbors, weight);
    assert_eq!(bias.len(), shape.d_out, "bias [D_out]");
    let weight = transpose(weight, shape.d_out);
    let mut y = vec![0.0; neighbors.len() / shape.k * shape.d_out];
    y.par_chunks_mut(BLOCK_ROWS * shape.d_out).zip(neighbors.par_chunks(BLOCK_ROWS * shape.k)).for_each_init(
        Vec::new,
        |gathered, (y, neighbors)| {
            if work.is_canceled() {
                return;
            }
            // y begins as the bias, and the product of each group of slots adds to it.
            for row in y.chunks_exact_mut(shape.d_out) {
                row.copy_from_slice(bias);
            }
            let rows = neighbors.len() / shape.k;
            // At least one slot, if D_in alone exceeds the width of a group.
            let group = (GROUP_WIDTH / shape.d_in.max(1)).clamp(1, shape.k);
            for k in (0..shape.k).step_by(group) {
                let n = group.min(shape.k - k);
                let neighborhoods = neighbors.chunks_exact(shape.k);
                let slots = neighborhoods.flat_map(|neighborhood| &neighborhood[k..k + n]);
                gather(gathered, x, shape.d_in, slots.copied());
                let gathered = Matrix::dense(gathered, rows, n * shape.d_in);
                // In the transposed weight the rows of consecutive slots follow one another, so a group of them
                // is one matrix.
                let weight = &weight[k * shape.d_in * shape.d_out..];
                product(y, true, gathered, Matrix::dense(weight, n * shape.d_in, shape.d_out));
            }
            finish(y);
        },
    );
    y
}

/// Gradient of a loss with respect to the weight `[D_out, K, D_in]`, from x and `grad_y` `[N_out, D_out]`:
/// dW_k = sum_p dy_p x_{n(p,k)}^T.
///
/// The rows are gathered again and not kept from the forward pass, since K D_in floats per row are too many to
/// hold.
pub fn knn_conv_backward_weight(
    shape: KnnConvShape,
    x: &[f32],
    neighbors: &[u32],
    grad_y: &[f32],
) -> Vec<f32> {
    let KnnConvShape { k: n_slots, d_in, d_out } = shape;
    assert_eq!(grad_y.len() / d_out, neighbors.len() / n_slots, "grad_y [N_out, D_out]");
    // Threads share out slots and not blocks of rows: each sum then has one owner and one order.
    let slots: Vec<Vec<f32>> = (0..n_slots)
        .into_par_iter()
        .map(|k| {
            let (mut slot, mut gathered) = (vec![0.0; d_out * d_in], Vec::new());
            let blocks = grad_y.chunks(BLOCK_ROWS * d_out).zip(neighbors.chunks(BLOCK_ROWS * n_slots));
            for (grad_y, neighbors) in blocks {
                let rows = neighbors.len() / n_slots;
                gather(&mut gathered, x, d_in, neighbors.iter().skip(k).step_by(n_slots).copied());
                // A view with its strides exchanged. Nothing is copied.
                let grad_y = Matrix::dense(grad_y, rows, d_out).transposed();
                product(&mut slot, true, grad_y, Matrix::dense(&gathered, rows, d_in));
            }
            slot
        })
        .collect();
    let mut grad = vec![0.0; d_out * n_slots * d_in];
    // From [K, D_out, D_in], one piece per thread, to the order of the weight.
    for (k, slot) in slots.iter().enumerate() {
        for (row, values) in slot.chunks_exact(d_in).enumerate() {
            grad[(row * n_slots + k) * d_in..][..d_in].copy_from_slice(values);
        }
    }
    grad
}

/// Neighbor lists reversed: for every row q of x and every slot k, the output rows p with n(p,k) = q.
#[derive(Clone, Debug)]
pub struct ReverseNeighbors {
    k: usize,
    /// Position in `rows` of the first row of each (q, k) `[N_in * K + 1]`.
    starts: Vec<u32>,
    /// Output rows `[N_out * K]`.
    rows: Vec<u32>,
}

impl ReverseNeighbors {
    /// Reverses `neighbors` `[N_out, K]`, which index `n_in` rows, by a counting sort. It is stable, so that
    /// each list ascends and gradients always sum in the same order.
    pub fn new(neighbors: &[u32], k: usize, n_in: usize) -> Self {
        let mut starts = vec![0_u32; n_in * k + 1];
        let slot = |(i, &q): (usize, &u32)| q as usize * k + i % k;
        // Counted one entry further on, so that the running sum below turns counts into starts.
        for entry in neighbors.iter().enumerate() {
            starts[slot(entry) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut rows = vec![0; neighbors.len()];
        for (i, q) in neighbors.iter().enumerate() {
            let position = &mut next[slot((i, q))];
            rows[*position as usize] = (i / k) as u32;
            *position += 1;
        }
        Self { k, starts, rows }
    }

    /// The output rows that have q in slot k.
    fn rows(&self, q: usize, k: usize) -> &[u32] {
        let slot = q * self.k + k;
        &self.rows[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }

    /// Appends the sum of dy_p `[D_out]` over the output rows p that have q in slot k.
    fn append_sum(&self, sums: &mut Vec<f32>, q: usize, k: usize, grad_y: &[f32], d_out: usize) {
        let row = |p: u32| &grad_y[p as usize * d_out..][..d_out];
        let Some((&first, others)) = self.rows(q, k).split_first() else {
            sums.resize(sums.len() + d_out, 0.0);
            return;
        };
        let start = sums.len();
        sums.extend_from_slice(row(first));
        for &p in others {
            sums[start..].iter_mut().zip(row(p)).for_each(|(sum, value)| *sum += value);
        }
    }

    /// N_in, the number of rows of x.
    pub fn n_in(&self) -> usize {
        (self.starts.len() - 1) / self.k
    }
}

/// Gradient of a loss with respect to x `[N_in, D_in]`: dx_q = sum_k (sum_{p: n(p,k) = q} dy_p) W_k.
///
/// Sums are gathered through the reversed neighbor lists, so none needs an atomic. Whichever moves fewer values
/// comes first: the sums of dy, which are multiplied for N_in rows, or the products dy_p W_k of N_out rows,
/// whose sums are dx. The former suits a wide x, the latter a picture's convolution with a stride or of three
/// channels.
pub fn knn_conv_backward_input(
    shape: KnnConvShape,
    reverse: &ReverseNeighbors,
    weight: &[f32],
    grad_y: &[f32],
) -> Vec<f32> {
    assert_eq!(reverse.k, shape.k, "K of the reversed neighbor lists");
    let n_out = grad_y.len() / shape.d_out;
    if n_out * shape.d_in < reverse.n_in() * shape.d_out {
        sums_of_products(shape, reverse, weight, grad_y)
    } else {
        products_of_sums(shape, reverse, weight, grad_y)
    }
}

/// [`knn_conv_backward_input`] as (sum_p dy_p) W_k, for some slots at a time as in [`knn_conv`].
fn products_of_sums(
    shape: KnnConvShape,
    reverse: &ReverseNeighbors,
    weight: &[f32],
    grad_y: &[f32],
) -> Vec<f32> {
    let KnnConvShape { k: n_slots, d_in, d_out } = shape;
    let mut by_slot = Vec::with_capacity(weight.len());
    for k in 0..n_slots {
        // [K, D_out, D_in], in which consecutive slots are one matrix.
        by_slot.extend(weight.chunks_exact(n_slots * d_in).flat_map(|row| &row[k * d_in..][..d_in]));
    }
    let group = (GROUP_WIDTH / d_out).clamp(1, n_slots);
    let mut grad_x = vec![0.0; reverse.n_in() * d_in];
    grad_x.par_chunks_mut(BLOCK_ROWS * d_in).enumerate().for_each_init(Vec::new, |sums, (block, grad_x)| {
        let n_rows = grad_x.len() / d_in;
        for k in (0..n_slots).step_by(group) {
            let n = group.min(n_slots - k);
            sums.clear();
            for row in block * BLOCK_ROWS..block * BLOCK_ROWS + n_rows {
                for k in k..k + n {
                    reverse.append_sum(sums, row, k, grad_y, d_out);
                }
            }
            let sums = Matrix::dense(sums, n_rows, n * d_out);
            let weight = &by_slot[k * d_out * d_in..];
            product(grad_x, true, sums, Matrix::dense(weight, n * d_out, d_in));
        }
    });
    grad_x
}

/// [`knn_conv_backward_input`] as sum_p (dy_p W_k).
fn sums_of_products(
    shape: KnnConvShape,
    reverse: &ReverseNeighbors,
    weight: &[f32],
    grad_y: &[f32],
) -> Vec<f32> {
    let KnnConvShape { k: n_slots, d_in, d_out } = shape;
    let width = n_slots * d_in;
    // dy W `[N_out, K * D_in]`.
    let mut products = vec![0.0; grad_y.len() / d_out * width];
    let blocks = products.par_chunks_mut(BLOCK_ROWS * width).zip(grad_y.par_chunks(BLOCK_ROWS * d_out));
    blocks.for_each(|(products, grad_y)| {
        let grad_y = Matrix::dense(grad_y, grad_y.len() / d_out, d_out);
        product(products, false, grad_y, Matrix::dense(weight, d_out, width));
    });
    let sum_products = |q: usize, grad_x: &mut [f32]| {
        for k in 0..n_slots {
            for &p in reverse.rows(q, k) {
                let product = &products[p as usize * width + k * d_in..][..d_in];
                grad_x.iter_mut().zip(product).for_each(|(sum, value)| *sum += value);
            }
        }
    };
    // Sums of colors stay in registers.
    let sum_colors = |q: usize, grad_x: &mut [f32]| {
        let (products, _) = products.as_chunks::<3>();
        let mut sum = [0.0; 3];
        for k in 0..n_slots {
            for &p in reverse.rows(q, k) {
                let product = products[p as usize * n_slots + k];
                sum = std::array::from_fn(|i| sum[i] + product[i]);
            }
        }
        grad_x.copy_from_slice(&sum);
    };
    let mut grad_x = vec![0.0; reverse.n_in() * d_in];
    let rows = grad_x.par_chunks_exact_mut(d_in).with_min_len(BLOCK_ROWS).enumerate();
    match d_in {
        3 => rows.for_each(|(q, grad_x)| sum_colors(q, grad_x)),
        _ => rows.for_each(|(q, grad_x)| sum_products(q, grad_x)),
    }
    grad_x
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: KnnConvShape = KnnConvShape { k: 2, d_in: 3, d_out: 2 };
    // In slot 1, row 1 comes twice and row 0 never: gradients must sum, and a reversed list may be empty.
    const NEIGHBORS: [u32; 6] = [0, 1, 1, 2, 2, 1];

    fn values(n: usize, seed: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7 + seed * 13) % 11) as f32 / 5.0 - 1.0).collect()
    }

    fn loss(x: &[f32], weight: &[f32], bias: &[f32], direction: &[f32]) -> f64 {
        let y = knn_conv(SHAPE, x, &NEIGHBORS, weight, bias, |_| ());
        y.iter().zip(direction).map(|(y, d)| f64::from(y * d)).sum()
    }

    #[test]
    fn forward_matches_a_hand_worked_case() {
        let x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        // W_0 picks channel 0 into output 0 and channel 1 into output 1; W_1 adds channel 2 twice into output
        // 0.
        let weight = [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let y = knn_conv(SHAPE, &x, &NEIGHBORS, &weight, &[0.5, -0.5], |_| ());
        assert_eq!(y, [1.0 + 12.0 + 0.5, 1.5, 4.0 + 18.0 + 0.5, 4.5, 7.0 + 12.0 + 0.5, 7.5]);
    }

    #[test]
    fn gradients_match_finite_differences() {
        let (x, weight, bias) = (values(9, 1), values(12, 2), values(2, 3));
        let direction = values(6, 4);
        let reverse = ReverseNeighbors::new(&NEIGHBORS, SHAPE.k, 3);
        let grad_x = knn_conv_backward_input(SHAPE, &reverse, &weight, &direction);
        let grad_weight = knn_conv_backward_weight(SHAPE, &x, &NEIGHBORS, &direction);
        let step = 0.25; // the map is linear in each argument: any step is exact up to rounding
        let check = |which: usize, grads: &[f32]| {
            for (i, grad) in grads.iter().enumerate() {
                let mut arguments = [x.clone(), weight.clone(), bias.clone()];
                arguments[which][i] += step;
                let [x1, weight1, bias1] = &arguments;
                let difference = loss(x1, weight1, bias1, &direction) - loss(&x, &weight, &bias, &direction);
                assert!(
                    (difference / f64::from(step) - f64::from(*grad)).abs() < 1e-5,
                    "argument {which}[{i}]"
                );
            }
        };
        check(0, &grad_x);
        check(1, &grad_weight);
    }

    #[test]
    fn both_orders_of_the_input_gradient_agree() {
        // More than a block, in which lists are empty, of one row, and of some.
        let (n_in, n_out) = (BLOCK_ROWS * 2 + 17, BLOCK_ROWS + 5);
        let neighbors: Vec<u32> = (0..n_out * 3).map(|i| (i * i % n_in) as u32).collect();
        let reverse = ReverseNeighbors::new(&neighbors, 3, n_in);
        // Colors have sums of their own.
        for d_in in [3, 5] {
            let shape = KnnConvShape { k: 3, d_in, d_out: 4 };
            let (weight, grad_y) = (values(4 * 3 * d_in, 2), values(n_out * 4, 3));
            let one = products_of_sums(shape, &reverse, &weight, &grad_y);
            let other = sums_of_products(shape, &reverse, &weight, &grad_y);
            assert_eq!(one.len(), n_in * d_in);
            assert!(one.iter().any(|value| value.abs() > 1.0));
            for (one, other) in one.iter().zip(&other) {
                assert!((one - other).abs() < 1e-4, "{d_in} channels: {one} {other}");
            }
        }
    }

    #[test]
    fn blocks_agree_with_single_rows() {
        let shape = KnnConvShape { k: 3, d_in: 5, d_out: 4 };
        // Two whole blocks and a part of one.
        let n = BLOCK_ROWS * 2 + 17;
        let x = values(n * 5, 1);
        let neighbors: Vec<u32> = (0..n * 3).map(|i| ((i * 31 + 7) % n) as u32).collect();
        let (weight, bias) = (values(4 * 15, 2), values(4, 3));
        let y = knn_conv(shape, &x, &neighbors, &weight, &bias, |_| ());
        for p in [0, BLOCK_ROWS - 1, BLOCK_ROWS, n - 1] {
            let row = knn_conv(shape, &x, &neighbors[p * 3..p * 3 + 3], &weight, &bias, |_| ());
            for (a, b) in row.iter().zip(&y[p * 4..]) {
                assert!((a - b).abs() < 1e-5);
            }
        }
    }
}
