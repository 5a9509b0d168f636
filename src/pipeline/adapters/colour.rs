//! Red, green and blue of renderers: colours of a known luminance, made showable.

use crate::vocabulary::spectrum::linear_srgb;

/// What red, green and blue mean to a renderer.
pub struct Primaries {
    /// Red, green and blue of tristimulus values; negative outside of what the primaries can show.
    pub from_xyz: fn([f64; 3]) -> [f64; 3],
    /// Luminance of 1 of each; they sum to 1.
    pub luminance: [f64; 3],
}

/// Linear sRGB (IEC 61966-2-1).
pub const SRGB: Primaries = Primaries {
    from_xyz: linear_srgb,
    luminance: [0.212_639_005_871_51, 0.715_168_678_767_756, 0.072_192_315_360_734],
};

/// The primaries of Radiance (its `color.h`: (0.640, 0.330), (0.290, 0.600), (0.150, 0.060), white (1/3, 1/3)).
pub const RADIANCE: Primaries =
    Primaries { from_xyz: radiance_rgb, luminance: [0.265_105_82, 0.670_105_82, 0.064_788_36] };

fn radiance_rgb([x, y, z]: [f64; 3]) -> [f64; 3] {
    [
        2.565_312_843 * x - 1.166_849_616 * y - 0.398_463_227 * z,
        -1.022_108_172 * x + 1.978_286_617 * y + 0.043_821_555 * z,
        0.074_724_377 * x - 0.251_939_567 * y + 1.177_215_190 * z,
    ]
}

/// Red, green and blue of luminance 1 with the colour of `xyz`. What the primaries cannot show loses saturation until the least of the three
/// is 0, so its luminance stays; without any light it is white.
pub fn unit_luminance(xyz: [f64; 3], primaries: &Primaries) -> [f64; 3] {
    let rgb = (primaries.from_xyz)(xyz);
    let luminance: f64 = rgb.iter().zip(primaries.luminance).map(|(part, weight)| part * weight).sum();
    if luminance <= 0.0 {
        return [1.0; 3];
    }
    let rgb = rgb.map(|part| part / luminance);
    let least = rgb.into_iter().fold(0.0, f64::min);
    rgb.map(|part| ((part - least) / (1.0 - least)).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vocabulary::spectrum::color_matching;

    /// White of IEC 61966-2-1 is (1, 1, 1) of sRGB, even light that of Radiance; a pure red keeps its luminance and has no blue, no green below 0.
    #[test]
    fn white_is_white_and_every_colour_keeps_its_luminance() {
        let d65 = [0.3127 / 0.3290, 1.0, 0.3583 / 0.3290];
        assert!(unit_luminance(d65, &SRGB).iter().all(|part| (part - 1.0).abs() < 1e-3));
        assert!(unit_luminance([1.0; 3], &RADIANCE).iter().all(|part| (part - 1.0).abs() < 1e-6));
        for primaries in [&SRGB, &RADIANCE] {
            assert!((primaries.luminance.iter().sum::<f64>() - 1.0).abs() < 1e-7);
            for nm in [450.0, 500.0, 525.0, 590.0, 632.0] {
                let rgb = unit_luminance(color_matching(nm), primaries);
                let luminance: f64 = rgb.iter().zip(primaries.luminance).map(|(part, weight)| part * weight).sum();
                assert!((luminance - 1.0).abs() < 1e-6 && rgb.iter().all(|part| *part >= 0.0), "{nm}: {rgb:?}");
                let strongest = if nm < 480.0 {
                    2
                } else if nm < 560.0 {
                    1
                } else {
                    0
                };
                assert!(rgb.iter().all(|part| *part <= rgb[strongest]), "{nm}: {rgb:?}");
            }
            assert_eq!(unit_luminance([0.0; 3], primaries), [1.0; 3]);
        }
    }
}
