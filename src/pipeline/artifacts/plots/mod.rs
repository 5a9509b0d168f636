//! The drawings of a model, `plots/*.svg`.

/// The surface in a three-quarter view.
pub mod hull;
/// Polar curves of intensity.
pub mod polar;
/// How good the model is.
pub mod quality;
/// The volume that light comes from, seen through.
pub mod volume;
/// The zones: the lattice coloured by flux, or the surface.
pub mod zones;
