//! Words that at least two stages speak. Knows no stage.

/// Numbers as people write them.
pub mod number;
/// Radiant and luminous flux, and what is known of each.
pub mod units;
/// The source frame: axes, boxes, the photometric frame.
pub mod space;
/// Wavelengths: bands, tables, the CIE observer, display colour.
pub mod spectrum;
/// One rule for wavelengths: which unit they are in, what is light.
pub mod wavelength;
/// The CIE 1931 2° observer, tabulated.
mod cie_1931;
/// What a caller allows an input to ask of this machine.
pub mod limits;
/// What was repaired, dropped or refused while reading, counted.
pub mod notice;
/// Progress out, cancellation in.
pub mod watch;
/// What a user declares of a ray file, before the file's own word.
pub mod declaration;
