//! To come.
/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(
    _bytes: std::sync::Arc<dyn super::Bytes>,
    _limits: &super::super::vocabulary::limits::Limits,
) -> Result<super::RaySet, super::super::Error> {
    todo!()
}
