//! Texts and totals that a converted file takes from its source, whatever its format.

use crate::formats::record::Facts;
use crate::rays::Input;
use crate::source::Channel;
use crate::vocabulary::units::Flux;

/// What the file says under `name`.
pub fn text<'f>(facts: &'f Facts, name: &str) -> &'f str {
    facts.texts.iter().find(|(own, _)| own == name).map_or("", |(_, value)| value)
}

/// What the light is called: by its user, by the file, or as the file is.
pub fn called<'a>(input: &'a Input, facts: &'a Facts) -> &'a str {
    let names = ["source_name", "description", "dataname", "title"].map(|name| text(facts, name));
    let declared = input.declared.name.as_deref();
    declared.into_iter().chain(names).find(|name| !name.is_empty()).unwrap_or(&input.name)
}

/// The total to be written: the header's own number where the rays agree with it, so that a file converted to its own format
/// keeps it to the last digit. A declared flux leaves nothing of the header.
pub fn total(channel: &Channel, of: impl Fn(&Flux) -> Option<f64>) -> Option<f64> {
    const SAME: f64 = 1e-6;
    let header = of(&channel.facts().header_flux).filter(|_| channel.fixed.is_none());
    match (header, of(&channel.flux)) {
        (Some(header), Some(rays)) if (header / rays - 1.0).abs() > SAME => Some(rays),
        (header, rays) => header.or(rays),
    }
}
