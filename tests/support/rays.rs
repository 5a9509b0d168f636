//! Ray files for tests that care about bytes, not about light. Written after the vendor's format page (Zemax binary: a 208-byte
//! header, then 28 bytes a ray), not with our own writer.

/// Bytes of the header.
const HEADER_BYTES: usize = 208;
/// A Zemax binary source file of `rays` rays: a square of 1 mm that shines along +Z, 1 W each.
pub fn zemax(rays: u32) -> Vec<u8> {
    let mut file = vec![0; HEADER_BYTES];
    let mut word = |at: usize, value: [u8; 4]| file[at..at + 4].copy_from_slice(&value);
    word(0, 1010_i32.to_le_bytes());
    word(4, rays.to_le_bytes());
    word(108, (rays as f32).to_le_bytes());
    word(112, (rays as f32).to_le_bytes());
    word(116, 0.55_f32.to_le_bytes());
    word(136, 4_i32.to_le_bytes());
    file[8..12].copy_from_slice(b"test");
    for ray in 0..rays {
        let (x, y) = ((ray % 997) as f32 / 997.0, (ray % 991) as f32 / 991.0);
        for value in [x, y, 0.0, 0.0, 0.0, 1.0, 1.0] {
            file.extend(value.to_le_bytes());
        }
    }
    file
}
