//! How good the model is: its error in each view beside that of the rays that it was made of, on a logarithmic scale.

use crate::artifacts::provenance::source_name;
use crate::model::Model;
use crate::model::study::Study;
use crate::writing::Artifact;
use crate::writing::number::text;
use crate::writing::polar_chart::C0_COLOR;
use crate::writing::svg::{Anchor, FAINT, INK, MUTED, Svg, one_line};

/// Width of the sheet, where the scale begins and ends, and the top of the first view, px.
const WIDTH: f64 = 680.0;
const LEFT: f64 = 150.0;
const RIGHT: f64 = 590.0;
const TOP: f64 = 104.0;
/// Height of a view and of a bar, px.
const VIEW_PX: f64 = 46.0;
const BAR_PX: f64 = 13.0;
/// Room for the number of a bar, px.
const NUMBER_PX: f64 = 46.0;
/// Errors at which the scale begins and ends.
const LEAST: f64 = 0.001;
const GREATEST: f64 = 1.0;
/// Colour of the bars of the rays.
const RAYS_COLOR: &str = "#b8c1ca";

/// `plots/quality.svg`; `None` where no view had rays enough.
pub fn artifact(model: &Model, study: &Study) -> Option<Artifact> {
    let bottom = TOP + VIEW_PX * study.figures.len() as f64;
    let subtitle = format!(
        "root mean square errors of a model of {} of the rays, judged by {} others",
        study.training_rays, study.judging_rays
    );
    let mut svg = Svg::sheet(WIDTH, bottom + 44.0, &one_line(&source_name(model), 64), &subtitle);
    legend(&mut svg);
    for error in [LEAST, 0.01, 0.1, GREATEST] {
        svg.line([x(error), TOP - 6.0], [x(error), bottom], FAINT, 1.0);
        svg.label(x(error), bottom + 20.0, 11.0, Anchor::Middle, MUTED, &percent(error));
    }
    for (row, figure) in study.figures.iter().enumerate() {
        let top = TOP + VIEW_PX * row as f64;
        svg.label(LEFT - 12.0, top + 19.0, 12.0, Anchor::End, INK, &figure.view.to_string());
        for (line, (error, color)) in [(figure.model, C0_COLOR), (figure.rays, RAYS_COLOR)].into_iter().enumerate() {
            let y = top + (BAR_PX + 2.0) * line as f64;
            svg.rect([LEFT, y], [x(error) - LEFT, BAR_PX], color);
            // Beside the bar; beyond the line of the noise where that would run through the number.
            let hidden = (x(error)..x(error) + NUMBER_PX).contains(&x(figure.noise));
            let end = if hidden { x(figure.noise) } else { x(error) };
            svg.label(end + 6.0, y + 11.0, 11.0, Anchor::Start, MUTED, &percent(error));
        }
        let [from, to] = [top - 3.0, top + 2.0 * BAR_PX + 5.0];
        svg.line([x(figure.noise), from], [x(figure.noise), to], INK, 1.5);
    }
    (!study.figures.is_empty()).then(|| svg.artifact("plots/quality.svg"))
}

/// What bars and lines are.
fn legend(svg: &mut Svg) {
    let y = 80.0;
    for (left, color, name) in [(24.0, C0_COLOR, "model"), (100.0, RAYS_COLOR, "the rays themselves")] {
        svg.rect([left, y - 10.0], [12.0, 12.0], color);
        svg.label(left + 18.0, y, 12.0, Anchor::Start, INK, name);
    }
    svg.line([262.0, y - 12.0], [262.0, y + 3.0], INK, 1.5);
    svg.label(272.0, y, 12.0, Anchor::Start, INK, "noise: what is shorter cannot be told from no error");
}

/// Where an error lies on the scale, px; smaller ones lie at its beginning.
fn x(error: f64) -> f64 {
    let part = (error.clamp(LEAST, GREATEST) / LEAST).ln() / (GREATEST / LEAST).ln();
    LEFT + part * (RIGHT - LEFT)
}

fn percent(error: f64) -> String {
    if error < LEAST && error > 0.0 { "< 0.1 %".to_owned() } else { format!("{} %", text(100.0 * error, 2)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use crate::model::study::{Figure, View};

    #[test]
    fn every_view_has_two_bars_and_a_line() {
        let figure = |model: f64| Figure { view: View::FarField, model, rays: 0.1, noise: 0.01, correlation: 1.0 };
        let study = Study { figures: vec![figure(0.0), figure(0.03), figure(7.0)], ..Study::default() };
        let svg = String::from_utf8(artifact(&fixture::model(), &study).unwrap().bytes).unwrap();
        assert_eq!(svg.matches("<rect").count(), 1 + 2 + 2 * 3, "sheet, legend, bars");
        // 0.1 lies at two thirds of the scale from 0.001 to 1, 7 at its end.
        let third = (RIGHT - LEFT) / 3.0;
        assert!(svg.contains(&format!("width=\"{:.1}\"", 2.0 * third)) && svg.contains("width=\"440.0\""), "{svg}");
        assert!(svg.contains(">3 %<") && svg.contains(">0 %<") && svg.contains(">700 %<"), "{svg}");
    }

    #[test]
    fn without_figures_there_is_no_drawing() {
        assert_eq!(artifact(&fixture::model(), &Study::default()), None);
    }
}
