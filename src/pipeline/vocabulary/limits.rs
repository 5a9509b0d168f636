//! What a caller allows an input to ask of this machine. A file's own numbers never raise these.

/// Bounds given by the caller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Most rays in one ray set.
    pub max_rays: u64,
    /// Most spectral tables in one file.
    pub max_tables: usize,
    /// Most points of all spectral tables of one file together.
    pub max_table_points: usize,
    /// Most additional columns of a record.
    pub max_additional_columns: usize,
    /// Most bytes of free text.
    pub max_text_bytes: usize,
    /// Most cells of the hull's lattice; 4 bytes each.
    pub max_lattice_cells: usize,
    /// Most numbers in one table of sums (vertices or cells × quantities and spectral columns); 8 bytes each; there are two copies for a short time.
    pub max_tally_values: usize,
    /// Largest share of rays that may be refused before the whole set is.
    pub max_refused_share: f64,
    /// Most bytes that one packed file may unpack to, all its files together.
    pub max_expanded_bytes: u64,
    /// Most bytes that may come out of a packed byte. Ray files give 1 to 10.
    pub max_expansion_ratio: u64,
    /// Most files in one packed file.
    pub max_members: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_rays: 2_000_000_000,
            max_tables: 4096,
            max_table_points: 1_000_000,
            max_additional_columns: 256,
            max_text_bytes: 1 << 20,
            max_lattice_cells: 1 << 24,
            max_tally_values: 1 << 26,
            max_refused_share: 0.01,
            max_expanded_bytes: 64 << 30,
            max_expansion_ratio: 100,
            max_members: 1000,
        }
    }
}
