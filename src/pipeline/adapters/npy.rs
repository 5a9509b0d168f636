//! Arrays as numpy stores them: the NPY format 1.0, little-endian.

use crate::writing::Artifact;

/// The header ends at a multiple of so many bytes.
const ALIGNMENT: usize = 64;

fn array(name: &str, kind: &str, shape: &[usize], numbers: impl Iterator<Item = [u8; 4]>) -> Artifact {
    let counts: Vec<String> = shape.iter().map(usize::to_string).collect();
    // A tuple of one has a comma behind it.
    let shape = counts.join(", ") + if counts.len() == 1 { "," } else { "" };
    let facts = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    // Magic, version and the length of what follows are ten bytes; a line end closes the header.
    let length = (10 + facts.len() + 1).next_multiple_of(ALIGNMENT) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{facts:<width$}\n", width = length - 1).into_bytes());
    bytes.extend(numbers.flatten());
    Artifact { name: format!("{name}.npy"), media_type: "application/octet-stream", bytes }
}

/// 32-bit floats, the last index fastest.
pub fn floats(name: &str, shape: &[usize], numbers: impl Iterator<Item = f64>) -> Artifact {
    array(name, "<f4", shape, numbers.map(|number| (number as f32).to_le_bytes()))
}

/// 32-bit whole numbers, the last index fastest.
pub fn indices(name: &str, shape: &[usize], numbers: impl Iterator<Item = u32>) -> Artifact {
    array(name, "<u4", shape, numbers.map(u32::to_le_bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes that numpy 2.4 writes: `np.save(f, np.array([[1, 2, 3]], '<u4'))`.
    #[test]
    fn an_array_has_the_bytes_that_numpy_writes() {
        let header = b"\x93NUMPY\x01\x00v\x00{'descr': '<u4', 'fortran_order': False, 'shape': (1, 3), }";
        let bytes = indices("a", &[1, 3], [1, 2, 3].into_iter()).bytes;
        assert_eq!(bytes.len(), 128 + 12);
        assert!(bytes.starts_with(header));
        assert!(bytes[header.len()..127].iter().all(|byte| *byte == b' ') && bytes[127] == b'\n');
        assert_eq!(bytes[128..], [1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0]);
    }
}
