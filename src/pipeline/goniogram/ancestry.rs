//! Where zones come from: which kind, and which part of it.

/// Parts with this number and higher ones are not halved.
const MOST_PARTS: u32 = 1 << 24;

/// Where a zone comes from: zones of one kind are alike, and parts of a kind that were halved again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ancestry {
    /// The kind.
    pub kind: u32,
    /// Number of the part in the tree of halves: 1 the kind, then 2n and 2n + 1 the halves of part n.
    part: u32,
}

impl Ancestry {
    /// A kind as one zone.
    pub fn whole(kind: u32) -> Ancestry {
        Ancestry { kind, part: 1 }
    }

    /// How many kinds a family has.
    pub fn kinds(family: &[Ancestry]) -> u32 {
        family.iter().map(|zone| zone.kind + 1).max().unwrap_or(0)
    }

    /// Number of the part that the zone was in when its kind had been halved `depth` times.
    pub fn at(self, depth: u32) -> u32 {
        self.part >> self.part.ilog2().saturating_sub(depth)
    }

    /// Whether the zone was a whole part when its kind had been halved `depth` times.
    pub fn is_whole_at(self, depth: u32) -> bool {
        self.part.ilog2() <= depth
    }

    /// Whether its halves have numbers yet.
    pub fn may_halve(self) -> bool {
        self.part < MOST_PARTS
    }

    /// Its halves.
    pub fn halves(self) -> [Ancestry; 2] {
        [2 * self.part, 2 * self.part + 1].map(|part| Ancestry { part, ..self })
    }
}
