//! Groups of things that hang together (disjoint sets).

/// Things `0..n`, each in one group. A group is named by its smallest member, so names do not depend on the order of joining.
pub struct Groups(Vec<u32>);

impl Groups {
    /// Everything alone.
    pub fn new(count: usize) -> Groups {
        Groups((0..count as u32).collect())
    }

    /// The smallest member of the group of `thing`.
    pub fn of(&mut self, thing: u32) -> u32 {
        let mut at = thing;
        while self.0[at as usize] != at {
            let up = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = up;
            at = up;
        }
        at
    }

    /// Makes the groups of both one.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// Number of members of each group, at its name's place; 0 elsewhere.
    pub fn sizes(&mut self) -> Vec<u32> {
        let mut sizes = vec![0; self.0.len()];
        for thing in 0..self.0.len() as u32 {
            sizes[self.of(thing) as usize] += 1;
        }
        sizes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_smallest_members() {
        let mut groups = Groups::new(6);
        groups.join(5, 3);
        groups.join(4, 1);
        groups.join(3, 4);
        assert_eq!((0..6).map(|n| groups.of(n)).collect::<Vec<_>>(), [0, 1, 2, 1, 1, 1]);
        assert_eq!(groups.sizes(), [1, 4, 1, 0, 0, 0]);
    }
}
