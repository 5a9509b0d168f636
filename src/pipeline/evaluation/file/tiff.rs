//! TIFF 6.0, one page a channel and after them one for the bounds of each: 32-bit floats in the channel's unit, not scaled. `ImageDescription` of
//! each page says what its numbers are, `PageName` the channel.

use crate::error::Error;
use crate::evaluation::answer::Answer;
use crate::writing::json::unwritten;
use crate::writing::svg::one_line;
use std::io::Cursor;
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray32Float;
use tiff::tags::Tag;

/// Longest name of a model in a description.
const LONGEST_NAME: usize = 200;

/// The pictures.
///
/// # Errors
/// [`Error::Internal`] where the library cannot write them.
pub fn bytes(answer: &Answer) -> Result<Vec<u8>, Error> {
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).map_err(unwritten)?;
    let model = ascii(&one_line(&answer.model, LONGEST_NAME));
    let of = |numbers: &[f64]| numbers.iter().map(|value| *value as f32).collect::<Vec<f32>>();
    let values = answer.channels.iter().map(|channel| (channel, "value", of(&channel.values)));
    let bounds = answer.channels.iter().map(|channel| (channel, "bound of the error", of(&channel.bounds)));
    for (channel, what, numbers) in values.chain(bounds) {
        let told = format!("{model}; {}; {}; {what}; {}", answer.quantity, ascii(&channel.name), ascii(channel.unit));
        let (columns, rows) = (answer.columns as u32, answer.rows as u32);
        let mut page = encoder.new_image::<Gray32Float>(columns, rows).map_err(unwritten)?;
        let name = if what == "value" { ascii(&channel.name) } else { format!("{} bound", ascii(&channel.name)) };
        let software = concat!("lampwright ", env!("CARGO_PKG_VERSION"));
        let texts = [(Tag::ImageDescription, told.as_str()), (Tag::Unknown(285), &name), (Tag::Software, software)];
        texts.into_iter().try_for_each(|(tag, text)| page.encoder().write_tag(tag, text)).map_err(unwritten)?;
        page.write_data(&numbers).map_err(unwritten)?;
    }
    Ok(file.into_inner())
}

/// TIFF texts are ASCII.
fn ascii(text: &str) -> String {
    let one = |letter: char| if letter.is_ascii() && !letter.is_control() { letter } else { '?' };
    text.replace('²', "2").chars().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::answer::Channel;
    use crate::evaluation::emission::Kind;
    use crate::evaluation::request::Request;
    use crate::evaluation::view::View;
    use crate::vocabulary::space::{Axis, Frame};
    use tiff::decoder::{Decoder, DecodingResult};

    #[test]
    fn pages_are_channels_and_then_their_bounds() {
        let channel = |name: &str, from: f64| Channel {
            name: name.to_owned(),
            unit: "cd/m²",
            band_nm: None,
            values: (0..6).map(|cell| from + f64::from(cell)).collect(),
            bounds: vec![0.5 * from; 6],
        };
        let answer = Answer {
            model: "lämp".to_owned(),
            request: Request::of(View::Directions(Vec::new())),
            kind: Kind::Color,
            quantity: "luminance",
            frame: Frame::looking(Axis::PosZ),
            columns: 3,
            rows: 2,
            channels: vec![channel("X", 1.0), channel("Y", 1e7)],
            evaluations: 0,
            notices: Vec::new(),
        };
        let mut decoder = Decoder::new(Cursor::new(bytes(&answer).unwrap())).unwrap();
        let mut told = Vec::new();
        for page in 0..4 {
            assert_eq!(decoder.dimensions().unwrap(), (3, 2));
            let DecodingResult::F32(numbers) = decoder.read_image().unwrap() else { panic!("no floats") };
            let channel = &answer.channels[page % 2];
            let exact = if page < 2 { &channel.values } else { &channel.bounds };
            assert!(numbers.iter().zip(exact).all(|(read, exact)| f64::from(*read) == *exact), "{page}");
            told.push(decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap());
            if page < 3 {
                decoder.next_image().unwrap();
            }
        }
        assert!(!decoder.more_images());
        assert_eq!(told[1], "l?mp; luminance; Y; value; cd/m2");
        assert_eq!(told[3], "l?mp; luminance; Y; bound of the error; cd/m2");
    }
}
