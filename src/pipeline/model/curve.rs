//! A curve through all cells of a square or a cube that never leaves a cell but for one next to it: Hilbert's, in any number of dimensions (J.
//! Skilling, Programming the Hilbert curve, AIP Conf. Proc. 707, 381, 2004). Things in the order of the curve that follow each other lie near each
//! other, so that each stretch of them is compact.

/// Steps of each axis: 2^10.
const BITS: u32 = 10;

/// The place on the curve of a point of which each coordinate lies in 0..1.
pub fn along<const AXES: usize>(point: [f64; AXES]) -> u64 {
    let steps = f64::from(1_u32 << BITS);
    place(point.map(|at| (at * steps).clamp(0.0, steps - 1.0) as u32), BITS)
}

/// The place on the curve of a cell, whose coordinates have so many bits.
fn place<const AXES: usize>(mut at: [u32; AXES], bits: u32) -> u64 {
    // Each cube of the curve is turned round or mirrored by the coordinates above it: undone from the largest to the smallest.
    for bit in (1..bits).rev() {
        let below = (1 << bit) - 1;
        for axis in 0..AXES {
            let swapped = if at[axis] >> bit & 1 == 1 { below } else { 0 };
            at[0] ^= swapped;
            let exchanged = if swapped == 0 { (at[0] ^ at[axis]) & below } else { 0 };
            at[0] ^= exchanged;
            at[axis] ^= exchanged;
        }
    }
    // Then their bits, side by side, are the place in Gray's code.
    let mut gray = 0;
    for bit in (0..bits).rev() {
        for coordinate in at {
            gray = gray << 1 | u64::from(coordinate >> bit & 1);
        }
    }
    let mut place = gray;
    for shift in [1, 2, 4, 8, 16, 32] {
        place ^= place >> shift;
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every cell has a place of its own, the places leave none out, and cells that follow each other are neighbours.
    #[test]
    fn the_curve_goes_from_neighbour_to_neighbour() {
        let flat = (0..64 * 64).map(|cell| [cell % 64, cell / 64]).map(|at| (place(at, 6), [at[0], at[1], 0]));
        let cube = (0..16 * 16 * 16).map(|cell| [cell % 16, cell / 16 % 16, cell / 256]).map(|at| (place(at, 4), at));
        for mut cells in [flat.collect::<Vec<_>>(), cube.collect()] {
            cells.sort_unstable();
            assert!(cells.iter().zip(0..).all(|((place, _), number)| *place == number));
            let steps = |pair: &[(u64, [u32; 3])]| (0..3).map(|k| pair[0].1[k].abs_diff(pair[1].1[k])).sum::<u32>();
            assert!(cells.windows(2).all(|pair| steps(pair) == 1));
        }
        assert_eq!((along([0.0, 0.0]), along([-1.0, f64::NAN])), (0, 0));
    }
}
