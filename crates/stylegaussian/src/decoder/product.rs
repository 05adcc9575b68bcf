//! A safe interface to the SIMD matrix product of the gemm crate.

/// A number type for which gemm has a kernel: `f32` or `f64`.
pub trait Element: sealed::Sealed + Copy + From<f32> + 'static {}

impl Element for f32 {}
impl Element for f64 {}

mod sealed {
    /// Keeps other types out: gemm panics on a type that it does not know.
    pub trait Sealed {}

    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A strided view of a matrix `[rows, columns]`.
///
/// Element (i, j) is `values[i * row_stride + j * column_stride]`. The constructors check that the last element
/// lies within `values`, and so does every other, since strides are not negative.
#[derive(Clone, Copy)]
pub struct Matrix<'a, T: Element = f32> {
    values: &'a [T],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a, T: Element> Matrix<'a, T> {
    /// A view of `rows` rows of `columns` values, each row starting `row_stride` values after the one before.
    ///
    /// # Panics
    /// If the last row ends beyond `values`.
    pub fn strided(values: &'a [T], rows: usize, columns: usize, row_stride: usize) -> Self {
        let is_empty = rows == 0 || columns == 0;
        // Checked, since in release builds a sum that wraps would pass as a small one.
        let end = rows.saturating_sub(1).checked_mul(row_stride).and_then(|start| start.checked_add(columns));
        assert!(
            is_empty || end.is_some_and(|end| end <= values.len()),
            "a matrix of {rows} rows of {columns} with row stride {row_stride} does not fit {} values",
            values.len()
        );
        // Nothing above bounds the stride of a matrix of one row. No second row is ever addressed with it, but
        // gemm takes strides as `isize`.
        let row_stride = if rows > 1 { row_stride } else { columns };
        Self { values, rows, columns, row_stride, column_stride: 1 }
    }

    /// A dense row-major matrix.
    ///
    /// # Panics
    /// If `values` is shorter than `rows * columns`.
    pub fn dense(values: &'a [T], rows: usize, columns: usize) -> Self {
        Self::strided(values, rows, columns, columns)
    }

    /// The same values with rows and columns exchanged.
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// target = lhs rhs, or target += lhs rhs if `accumulate`; `target` is dense row-major
/// `[lhs.rows, rhs.columns]`.
///
/// Runs on the calling thread: callers split rows over threads.
///
/// # Panics
/// If `lhs` has another number of columns than `rhs` has rows, or `target` is shorter than the product.
pub fn product<T: Element>(target: &mut [T], accumulate: bool, lhs: Matrix<T>, rhs: Matrix<T>) {
    assert_eq!(lhs.columns, rhs.rows, "inner dimensions of a product");
    let (rows, columns, inner) = (lhs.rows, rhs.columns, lhs.columns);
    assert!(
        rows.checked_mul(columns).is_some_and(|n_values| n_values <= target.len()),
        "a product of {rows} rows of {columns} does not fit its target of {} values",
        target.len()
    );
    if rows == 0 || columns == 0 {
        return;
    }
    if inner == 0 {
        // A sum of no terms. `rows * columns` fits, as checked above.
        if !accumulate {
            target[..rows * columns].fill(T::from(0.0));
        }
        return;
    }
    // SAFETY:
    // - T is f32 or f64, which are the types that gemm has kernels for (`Element` is sealed).
    // - No dimension is 0 from here on, so each operand has a last element, and `Matrix` checked that it lies
    //   within the operand's slice: (rows - 1) * row_stride + (columns - 1) * column_stride < values.len().
    // - The target is written at i * columns + j for i < rows, j < columns, and rows * columns <= target.len().
    // - No stride turns negative as an `isize`: a stride along a dimension above 1 is below the length of its
    //   slice, one along a dimension of 1 is 1 or that slice's other extent, `columns` is at most the target's
    //   length, and no slice of f32 or f64 holds more than isize::MAX values.
    // - `target` is borrowed mutably, so that neither operand overlaps it.
    #[expect(unsafe_code, reason = "gemm takes pointers; the comment above names the bound of each")]
    unsafe {
        gemm::gemm(
            rows,
            columns,
            inner,
            target.as_mut_ptr(),
            1,
            columns as isize,
            accumulate,
            lhs.values.as_ptr(),
            lhs.column_stride as isize,
            lhs.row_stride as isize,
            rhs.values.as_ptr(),
            rhs.column_stride as isize,
            rhs.row_stride as isize,
            1.0.into(),
            1.0.into(),
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

/// The scalar product, in eight sums that one instruction adds.
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; 8];
    let (a_blocks, b_blocks) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = a_blocks.remainder().iter().zip(b_blocks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_blocks.zip(b_blocks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiplies_strided_and_transposed_views() {
        // [[1 2] [3 4]] [[5 7] [6 8]] = [[17 23] [39 53]]; the left matrix sits in rows of three.
        let lhs = [1.0, 2.0, 9.0, 3.0, 4.0, 9.0];
        let rhs_transposed = [5.0, 6.0, 7.0, 8.0];
        let mut target = [1.0; 4];
        let rhs = Matrix::dense(&rhs_transposed, 2, 2).transposed();
        product(&mut target, false, Matrix::strided(&lhs, 2, 2, 3), rhs);
        assert_eq!(target, [17.0, 23.0, 39.0, 53.0]);
        product(&mut target, true, Matrix::strided(&lhs, 2, 2, 3), rhs);
        assert_eq!(target, [34.0, 46.0, 78.0, 106.0]);
    }

    #[test]
    fn a_product_of_no_terms_is_zero() {
        let mut target = [1.0_f64; 3];
        let (lhs, rhs) = (Matrix::dense(&[], 2, 0), Matrix::dense(&[], 0, 1));
        product(&mut target, true, lhs, rhs);
        assert_eq!(target, [1.0; 3]);
        product(&mut target, false, lhs, rhs);
        assert_eq!(target, [0.0, 0.0, 1.0]);
    }

    /// With one row no second one is addressed, whatever the stride.
    #[test]
    fn the_stride_of_a_single_row_does_not_matter() {
        let mut target = [0.0_f32];
        let lhs = Matrix::strided(&[1.0, 2.0], 1, 2, usize::MAX);
        product(&mut target, false, lhs, Matrix::dense(&[3.0, 4.0], 2, 1));
        assert_eq!(target, [11.0]);
    }

    /// (2 - 1) * (MAX - 3) + 4 wraps to 0.
    #[test]
    #[should_panic(expected = "does not fit 8 values")]
    fn a_sum_that_wraps_is_refused() {
        Matrix::strided(&[0.0_f32; 8], 2, 4, usize::MAX - 3);
    }

    /// (3 - 1) * 2^63 wraps to 0.
    #[test]
    #[should_panic(expected = "does not fit 8 values")]
    fn a_stride_that_wraps_is_refused() {
        Matrix::strided(&[0.0_f32; 8], 3, 4, 1 << (usize::BITS - 1));
    }

    /// Rows at stride 0 are all the same one, so that any number of them fits: 2^63 rows of 2 wrap to 0.
    #[test]
    #[should_panic(expected = "does not fit its target of 1 values")]
    fn a_target_size_that_wraps_is_refused() {
        let lhs = Matrix::strided(&[1.0_f32], 1 << (usize::BITS - 1), 1, 0);
        product(&mut [0.0], false, lhs, Matrix::dense(&[1.0, 2.0], 1, 2));
    }

    #[test]
    #[should_panic(expected = "does not fit its target of 3 values")]
    fn a_target_that_is_too_short_is_refused() {
        product(&mut [0.0; 3], false, Matrix::dense(&[1.0, 2.0], 2, 1), Matrix::dense(&[1.0, 2.0], 1, 2));
    }
}
