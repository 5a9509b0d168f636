//! How a file is written: numbers, JSON, XML, drawings.

/// JSON that people can read too.
pub mod json;
/// Numbers as text: the one place where digits are counted.
pub mod number;
/// Axes, curves and legend of a polar chart.
pub mod polar_chart;
/// JSON Schemas of what is written.
pub mod schema;
/// Triangles to pixels, for hulls too fine to be drawn as polygons.
pub mod raster;
/// Values to colours.
pub mod scale;
/// XML: elements, attributes, text.
pub mod xml;
/// `plots/*.svg`.
pub mod svg;

/// One file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Path in the zip and in the download list, forward slashes.
    pub name: String,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub bytes: Vec<u8>,
}

impl Artifact {
    /// A text file.
    pub fn text(name: &str, media_type: &'static str, text: impl Into<String>) -> Artifact {
        Artifact { name: name.to_owned(), media_type, bytes: text.into().into_bytes() }
    }
}
