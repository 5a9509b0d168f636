//! Mirror planes of the light, and what they do to a grid.

/// Mirror planes through the axis of a focal surface that the light has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Symmetry {
    /// None that is known.
    None,
    /// Two, across each other.
    TwoMirrors,
    /// Four, 45° apart: those of a square; a round source has these too.
    FourMirrors,
}

impl Symmetry {
    /// How many images of a ray there are, itself included: a power of two.
    pub fn images(self) -> usize {
        match self {
            Symmetry::None => 1,
            Symmetry::TwoMirrors => 4,
            Symmetry::FourMirrors => 8,
        }
    }

    /// Cells of a symmetric grid, `[y][x]`, where any image of a cell is marked.
    pub fn spread(self, [columns, rows]: [usize; 2], mut marked: Vec<bool>) -> Vec<bool> {
        let mut join = |image: &dyn Fn(usize, usize) -> (usize, usize)| {
            marked = (0..columns * rows)
                .map(|cell| {
                    let (x, y) = image(cell % columns, cell / columns);
                    marked[cell] || marked[y * columns + x]
                })
                .collect();
        };
        if self != Symmetry::None {
            join(&|x, y| (columns - 1 - x, y));
            join(&|x, y| (x, rows - 1 - y));
        }
        if self == Symmetry::FourMirrors && columns == rows {
            join(&|x, y| (y, x));
        }
        marked
    }

    /// How many mirror planes there are.
    pub fn mirrors(self) -> u8 {
        match self {
            Symmetry::None => 0,
            Symmetry::TwoMirrors => 2,
            Symmetry::FourMirrors => 4,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_spread_to_all_images() {
        let mut marked = vec![false; 16];
        marked[1] = true;
        let spread = |symmetry: Symmetry| {
            let spread = symmetry.spread([4, 4], marked.clone());
            (0..16).filter(|cell| spread[*cell]).collect::<Vec<_>>()
        };
        assert_eq!(spread(Symmetry::None), [1]);
        assert_eq!(spread(Symmetry::TwoMirrors), [1, 2, 13, 14]);
        assert_eq!(spread(Symmetry::FourMirrors), [1, 2, 4, 7, 8, 11, 13, 14]);
    }
}
