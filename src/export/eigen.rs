//! The axes of an ellipsoid: eigenvectors of a symmetric 3 x 3 matrix, by Jacobi rotations.

use glam::{DMat3, DQuat, DVec3};

/// Most sweeps over the three pairs of axes; each about squares what is left off the diagonal.
const SWEEPS: usize = 16;

/// Returns a rotation and the half-axes along its columns, such that `matrix` is R D R^T with D their squares.
///
/// `matrix` is symmetric and positive definite. A diagonal matrix gives the identity.
pub(crate) fn ellipsoid_axes(matrix: DMat3) -> (DQuat, DVec3) {
    let (mut diagonal, mut rotation) = (matrix, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for [p, q] in [[0, 1], [0, 2], [1, 2]] {
            let off = diagonal.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(diagonal.col(q)[q] - diagonal.col(p)[p]);
            let (sine, cosine) = angle.sin_cos();
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cosine;
            turn.col_mut(q)[q] = cosine;
            turn.col_mut(q)[p] = sine;
            turn.col_mut(p)[q] = -sine;
            diagonal = turn.transpose() * diagonal * turn;
            rotation *= turn;
        }
    }
    let half_axes = DVec3::from_array([0, 1, 2].map(|a| diagonal.col(a)[a].max(0.0).sqrt()));
    (DQuat::from_mat3(&rotation).normalize(), half_axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_give_the_matrix_back() {
        for (x, y, z) in [
            (DVec3::X, DVec3::Y * 2.0, DVec3::Z * 3.0),
            (DVec3::new(0.6, 0.8, 0.0), DVec3::new(-0.8, 0.6, 0.0) * 5.0, DVec3::Z * 0.1),
            (DVec3::new(1.0, 0.2, -0.3), DVec3::new(0.0, 1.0, 0.5), DVec3::new(0.1, 0.1, 2.0)),
            (DVec3::X, DVec3::Y, -DVec3::Z),
        ] {
            let steps = DMat3::from_cols(x, y, z);
            let matrix = steps * steps.transpose();
            let (turn, axes) = ellipsoid_axes(matrix);
            let turn = DMat3::from_quat(turn);
            let back = turn * DMat3::from_diagonal(axes * axes) * turn.transpose();
            assert!((back - matrix).to_cols_array().iter().all(|error| error.abs() < 1e-9), "{matrix} {back}");
        }
    }
}
