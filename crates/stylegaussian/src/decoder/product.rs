//! A safe face for the SIMD matrix product.

/// A strided view of a matrix, of f32 or f64.
#[derive(Clone, Copy)]
pub struct Matrix<'a, T = f32> {
    values: &'a [T],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a, T> Matrix<'a, T> {
    /// `rows` rows of `columns` values, each row starting `row_stride` after the one before.
    pub fn strided(values: &'a [T], rows: usize, columns: usize, row_stride: usize) -> Self {
        assert!(
            rows == 0 || columns == 0 || (rows - 1) * row_stride + columns <= values.len(),
            "a matrix of {rows} rows of {columns} with row stride {row_stride} does not fit {} values",
            values.len()
        );
        Self { values, rows, columns, row_stride, column_stride: 1 }
    }

    /// A dense row-major matrix.
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

/// target = lhs rhs, or target += lhs rhs when `accumulate`; target is dense row-major `[lhs.rows, rhs.columns]`.
/// Runs on the calling thread: callers split rows over threads.
pub fn product<T: From<f32> + 'static>(target: &mut [T], accumulate: bool, lhs: Matrix<T>, rhs: Matrix<T>) {
    assert_eq!(lhs.columns, rhs.rows, "inner dimensions of a product");
    assert!(target.len() >= lhs.rows * rhs.columns, "the product's target is too small");
    if lhs.rows == 0 || rhs.columns == 0 {
        return;
    }
    #[expect(
        unsafe_code,
        reason = "gemm takes pointers; the views checked their bounds, the lines above the rest"
    )]
    unsafe {
        gemm::gemm(
            lhs.rows,
            rhs.columns,
            lhs.columns,
            target.as_mut_ptr(),
            1,
            rhs.columns as isize,
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
}
