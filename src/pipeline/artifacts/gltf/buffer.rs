//! The binary chunk of the glTF.

use super::document::{Accessor, View};
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The binary chunk and what lies where in it.
#[derive(Default)]
pub(super) struct Buffer {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<View>,
    pub(super) accessors: Vec<Accessor>,
}

impl Buffer {
    /// Three indices per triangle. Answers the accessor.
    pub(super) fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
        let view = self.view(start, ELEMENT_ARRAY_BUFFER, None);
        self.accessor(Accessor { component_type: UNSIGNED_INT, ..Accessor::new(view, "SCALAR", 3 * triangles.len()) })
    }

    /// Positions; their accessor must state the box. Answers the accessor.
    pub(super) fn positions(&mut self, positions: impl Iterator<Item = [f32; 3]> + Clone) -> usize {
        let mut min = [f32::INFINITY; 3];
        let mut max = [f32::NEG_INFINITY; 3];
        for position in positions.clone() {
            for k in 0..3 {
                min[k] = min[k].min(position[k]);
                max[k] = max[k].max(position[k]);
            }
        }
        let accessor = self.vectors(positions);
        if let Some(accessor) = self.accessors.get_mut(accessor) {
            // Exact in f64: readers compare the text with the floats in the buffer.
            (accessor.min, accessor.max) = (Some(min.map(f64::from)), Some(max.map(f64::from)));
        }
        accessor
    }

    /// Vectors of three floats. Answers the accessor.
    pub(super) fn vectors(&mut self, vectors: impl Iterator<Item = [f32; 3]>) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(vectors.flatten().flat_map(f32::to_le_bytes));
        let view = self.view(start, ARRAY_BUFFER, None);
        self.accessor(Accessor::new(view, "VEC3", (self.bytes.len() - start) / 12))
    }

    /// Four floats per vertex. Answers the accessor.
    pub(super) fn quadruples(&mut self, quadruples: impl Iterator<Item = [f32; 4]>) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(quadruples.flatten().flat_map(f32::to_le_bytes));
        let view = self.view(start, ARRAY_BUFFER, None);
        self.accessor(Accessor::new(view, "VEC4", (self.bytes.len() - start) / 16))
    }

    /// One float per vertex. Answers the accessor.
    pub(super) fn scalars(&mut self, scalars: impl Iterator<Item = f32>) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(scalars.flat_map(f32::to_le_bytes));
        let view = self.view(start, ARRAY_BUFFER, None);
        self.accessor(Accessor::new(view, "SCALAR", (self.bytes.len() - start) / 4))
    }

    /// Vertex-major `values` as one scalar accessor per band. They share a view, which then must state its stride.
    pub(super) fn bands(&mut self, values: &[f32], bands: usize) -> Vec<usize> {
        let start = self.bytes.len();
        for band in 0..bands {
            self.bytes.extend(values.iter().skip(band).step_by(bands).flat_map(|value| value.to_le_bytes()));
        }
        let view = self.view(start, ARRAY_BUFFER, Some(4));
        let count = values.len() / bands.max(1);
        (0..bands)
            .map(|band| {
                let byte_offset = 4 * count * band;
                self.accessor(Accessor { byte_offset, ..Accessor::new(view, "SCALAR", count) })
            })
            .collect()
    }

    /// A file as it is; what follows begins at a multiple of four. Answers the view.
    pub(super) fn file(&mut self, bytes: &[u8]) -> usize {
        let byte_offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(View { buffer: 0, byte_offset, byte_length: bytes.len(), byte_stride: None, target: None });
        self.views.len() - 1
    }

    fn view(&mut self, start: usize, target: u32, byte_stride: Option<usize>) -> usize {
        let (byte_length, target) = (self.bytes.len() - start, Some(target));
        self.views.push(View { buffer: 0, byte_offset: start, byte_length, byte_stride, target });
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Accessor) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}
