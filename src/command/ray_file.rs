//! Ray files on disk as the pipeline wants their bytes: random access, never more in memory than is asked for. What is packed
//! is unpacked into a temporary file without a name, one at a time: packed bytes cannot be read at random.

use super::terminal::failure::Failure;
use pipeline::formats::bytes::digest;
use pipeline::{Bytes, Content, Declared, Error, Input, Limits, MODEL_FILES, Member};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of bytes of a file in an archive that its format is judged by.
const PREFIX_BYTES: usize = 64 << 10;
/// Bytes unpacked at once.
const BLOCK_BYTES: usize = 256 << 10;

/// An open file and the length it had when it was opened.
struct OpenFile {
    file: File,
    byte_count: u64,
}

impl OpenFile {
    fn new(file: File) -> io::Result<OpenFile> {
        let byte_count = file.metadata()?.len();
        Ok(OpenFile { file, byte_count })
    }
}

impl Bytes for OpenFile {
    fn len(&self) -> u64 {
        self.byte_count
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(into, offset)
    }
}

/// Opens the one ray file that `path` is or holds (see [`find`]) and takes its digest: one reading of all of it.
///
/// # Errors
/// As [`find`]; there are several, and the user must choose.
pub fn open(path: &Path) -> Result<Input, Failure> {
    let found = find(path)?;
    if let [only] = found.rays.as_slice() {
        return found.open(only);
    }
    let several = format!("The archive contains {} ray files: {}.", found.rays.len(), found.listed());
    let remedy = format!("Choose one: {}:NAME.", found.shown());
    Err(Failure::usage("file.several", several, remedy).at(found.shown()))
}

/// The ray files that are one file on disk, or in it.
pub struct RayFiles {
    path: PathBuf,
    file: Arc<OpenFile>,
    is_packed: bool,
    /// Their places in the packed file, and their names.
    rays: Vec<(usize, String)>,
    /// What else is in it, and why it is no ray file.
    pub left_out: Vec<(String, Error)>,
}

/// Finds the ray files of `path`: FILE, or FILE:MEMBER for one in a packed file. Unpacks no more than their beginnings.
///
/// # Errors
/// The disk refuses an operation; or the archive is damaged, contains no ray file or not the named one.
pub fn find(path: &Path) -> Result<RayFiles, Failure> {
    let (path, member) = split(path);
    if path.is_dir() {
        return Err(folder(&path));
    }
    let disk = |error: io::Error| Failure::disk(&path, &error);
    let file = Arc::new(File::open(&path).and_then(OpenFile::new).map_err(disk)?);
    let mut start = vec![0; usize::try_from(file.len()).unwrap_or(4).min(4)];
    file.read_at(0, &mut start).map_err(disk)?;
    let is_packed = pipeline::packing(&start).is_some();
    let mut found = RayFiles { path, file, is_packed, rays: Vec::new(), left_out: Vec::new() };
    if is_packed {
        found.look()?;
    } else {
        found.rays.push((0, found.name()));
    }
    match member {
        Some(member) => found.choose(&member),
        None if found.rays.is_empty() => Err(found.without_rays()),
        None => Ok(found),
    }
}

/// A folder is no ray file; mostly it is a model.
fn folder(path: &Path) -> Failure {
    if MODEL_FILES.iter().all(|name| path.join(name).is_file()) {
        return Failure::from(pipeline::model_given()).at(path.display().to_string());
    }
    Failure::failed("file.folder", "This is a folder.", "Name a ray file that is in it.").at(path.display().to_string())
}

/// `path` where there is such a file; else what stands before and behind a colon, where before it there is one.
fn split(path: &Path) -> (PathBuf, Option<String>) {
    let text = path.to_string_lossy();
    let at = |(colon, _): (usize, &str)| Some((PathBuf::from(text.get(..colon)?), text.get(colon + 1..)?.to_owned()));
    let inside = || text.match_indices(':').filter_map(at).find(|(file, _)| file.is_file());
    match if path.exists() { None } else { inside() } {
        Some((file, member)) => (file, Some(member)),
        None => (path.to_owned(), None),
    }
}

impl RayFiles {
    /// What the ray files are called.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.rays.iter().map(|(_, name)| name.as_str())
    }

    fn listed(&self) -> String {
        self.names().collect::<Vec<_>>().join(", ")
    }

    fn shown(&self) -> String {
        self.path.display().to_string()
    }

    /// What the file on disk is called.
    fn name(&self) -> String {
        self.path.file_name().unwrap_or(self.path.as_os_str()).to_string_lossy().into_owned()
    }

    /// Opens them one after the other.
    pub fn open_all(&self) -> impl Iterator<Item = Result<Input, Failure>> {
        self.rays.iter().map(|one| self.open(one))
    }

    fn open(&self, (place, name): &(usize, String)) -> Result<Input, Failure> {
        let input = if self.is_packed { self.unpack(*place, name) } else { self.whole() }?;
        let left_out = self.left_out.iter().map(|(name, error)| (name.as_str(), error.code()));
        Ok(Input { notices: pipeline::left_out(&self.name(), left_out), ..input })
    }

    /// Only the ray file called `member`.
    fn choose(mut self, member: &str) -> Result<RayFiles, Failure> {
        if let Some(at) = self.left_out.iter().position(|(name, _)| name == member) {
            return Err(Failure::from(self.left_out.swap_remove(at).1).at(format!("{}:{member}", self.path.display())));
        }
        match self.rays.iter().position(|(_, name)| name == member) {
            // Who names one file of several does not miss the others.
            Some(at) if self.is_packed => {
                Ok(RayFiles { rays: vec![self.rays.swap_remove(at)], left_out: Vec::new(), ..self })
            }
            _ => {
                let found = format!("The archive contains no file {member:?}. Its ray files are: {}.", self.listed());
                Err(Failure::usage("file.member", found, "Choose one of these.").at(self.shown()))
            }
        }
    }

    fn without_rays(self) -> Failure {
        let inside = self.left_out.iter().map(|(name, error)| (name.as_str(), error.code(), error.found()));
        Failure::from(pipeline::no_ray_file(inside)).at(self.shown())
    }

    /// Judges the beginning of everything inside.
    fn look(&mut self) -> Result<(), Failure> {
        let (mut rays, mut left_out) = (Vec::new(), Vec::new());
        let mut place = 0;
        self.each(|name, content| {
            let judged = match content {
                Content::Open(mut member) => {
                    let (prefix, length) = beginning(&mut member)?;
                    pipeline::peek(&prefix, length, &Limits::default()).map(|_| ())
                }
                Content::Closed(error) => Err(error),
            };
            match judged {
                Ok(()) => rays.push((place, name.to_owned())),
                Err(error) => left_out.push((name.to_owned(), error)),
            }
            place += 1;
            Ok(())
        })?;
        (self.rays, self.left_out) = (rays, left_out);
        Ok(())
    }

    fn each(&self, visit: impl FnMut(&str, Content<'_>) -> Result<(), Failure>) -> Result<(), Failure> {
        let unpacked = pipeline::unpack(self.file.as_ref(), &self.name(), &Limits::default(), visit);
        unpacked.map_err(|failure| failure.at(self.shown()))
    }

    fn whole(&self) -> Result<Input, Failure> {
        let sha256 = digest(self.file.as_ref()).map_err(|error| Failure::disk(&self.path, &error))?;
        let bytes = self.file.clone();
        Ok(Input { name: self.name(), sha256, bytes, declared: Declared::default(), notices: Vec::new() })
    }

    /// Unpacks the file at `place`.
    fn unpack(&self, place: usize, name: &str) -> Result<Input, Failure> {
        let (mut at, mut input) = (0, None);
        self.each(|_, content| {
            if let (Content::Open(mut member), true) = (content, at == place) {
                input = Some(into_temporary(&mut member, name)?);
            }
            at += 1;
            Ok(())
        })?;
        let changed = || Failure::failed("file.changed", "The file changed while it was read.", "Try again.");
        input.ok_or_else(changed)
    }
}

/// The first bytes of a file inside, and its length where they are all.
fn beginning(member: &mut Member<'_>) -> Result<(Vec<u8>, Option<u64>), Error> {
    let (mut prefix, mut filled) = (vec![0; PREFIX_BYTES], 0);
    while filled < prefix.len() {
        match member.read(prefix.get_mut(filled..).unwrap_or_default())? {
            0 => {
                prefix.truncate(filled);
                return Ok((prefix, Some(filled as u64)));
            }
            count => filled += count,
        }
    }
    Ok((prefix, None))
}

fn into_temporary(member: &mut Member<'_>, name: &str) -> Result<Input, Failure> {
    let disk = |error: io::Error| {
        let remedy = "Free disk space for the unpacked file, or name a folder with more space in TMPDIR.";
        Failure::failed("file.temporary", error.to_string(), remedy).at(std::env::temp_dir().display().to_string())
    };
    let mut file = tempfile::tempfile().map_err(disk)?;
    let mut digest = Sha256::new();
    let mut block = vec![0; BLOCK_BYTES];
    loop {
        let count = member.read(&mut block)?;
        let read = block.get(..count).unwrap_or_default();
        if read.is_empty() {
            break;
        }
        digest.update(read);
        file.write_all(read).map_err(disk)?;
    }
    let bytes = Arc::new(OpenFile::new(file).map_err(disk)?);
    let sha256 = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(Input { name: name.to_owned(), sha256, bytes, declared: Declared::default(), notices: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::known_sources;

    #[test]
    fn a_file_is_its_bytes_anywhere() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.ray");
        std::fs::write(&path, "abc").unwrap();
        let input = open(&path).unwrap();
        // FIPS 180-4, example B.1.
        assert_eq!(input.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!((input.name.as_str(), input.bytes.len()), ("abc.ray", 3));
        let mut two = [0; 2];
        input.bytes.read_at(1, &mut two).unwrap();
        assert_eq!(&two, b"bc");
        assert_eq!(input.bytes.read_at(2, &mut two).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }

    /// CRC-32 of IEEE 802.3, bit by bit.
    fn crc32(bytes: &[u8]) -> u32 {
        let bit = |crc: u32, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit))
    }

    /// `zip -0`, by hand after APPNOTE 4.3.
    fn stored_zip(files: &[(&str, &[u8])]) -> Vec<u8> {
        let (mut zip, mut directory) = (Vec::new(), Vec::new());
        for (name, content) in files {
            let offset = zip.len() as u32;
            let length = (content.len() as u32).to_le_bytes();
            let shared =
                [&[20, 0, 0, 0, 0, 0, 0, 0, 0, 0][..], &crc32(content).to_le_bytes(), &length, &length].concat();
            let shared = [&shared[..], &(name.len() as u16).to_le_bytes(), &[0, 0]].concat();
            zip.extend([b"PK\x03\x04", &shared[..], name.as_bytes(), content].concat());
            let entry = [b"PK\x01\x02\x14\0", &shared[..], &[0; 10], &offset.to_le_bytes(), name.as_bytes()];
            directory.extend(entry.concat());
        }
        let (count, offset) = ((files.len() as u16).to_le_bytes(), (zip.len() as u32).to_le_bytes());
        let length = (directory.len() as u32).to_le_bytes();
        [&zip[..], &directory, b"PK\x05\x06\0\0\0\0", &count, &count, &length, &offset, &[0, 0]].concat()
    }

    /// A ray file, another for another seed.
    fn rays(seed: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        known_sources::write_tm25(&known_sources::by_name("flat-chip").unwrap(), 9, seed, &mut bytes).unwrap();
        bytes
    }

    fn lamp(folder: &Path) -> PathBuf {
        let path = folder.join("lamp.zip");
        let zip = stored_zip(&[("x/blue", &rays(1)), ("note.txt", b"Hello."), ("red", &rays(2))]);
        std::fs::write(&path, zip).unwrap();
        path
    }

    fn content(input: &Input) -> Vec<u8> {
        let mut all = vec![0; input.bytes.len() as usize];
        input.bytes.read_at(0, &mut all).unwrap();
        all
    }

    #[test]
    fn every_ray_file_in_a_packed_one_is_found_and_opened() {
        let folder = tempfile::tempdir().unwrap();
        let found = find(&lamp(folder.path())).unwrap();
        let opened = found.open_all().map(|input| input.unwrap());
        let opened: Vec<_> = opened.map(|input| (input.name.clone(), input.sha256.clone(), content(&input))).collect();
        let expected = [("x/blue", rays(1)), ("red", rays(2))].map(|(name, bytes)| {
            let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
            (name.to_owned(), sha256, bytes)
        });
        assert_eq!(opened, expected);
        let left: Vec<_> = found.left_out.iter().map(|(name, error)| (name.as_str(), error.code())).collect();
        assert_eq!(left, [("note.txt", "detect.not_rays")]);
    }

    #[test]
    fn of_several_ray_files_the_user_chooses_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = lamp(folder.path());
        let failure = open(&path).err().unwrap().to_string();
        for part in ["file.several", "x/blue, red", "lamp.zip:NAME"] {
            assert!(failure.contains(part), "{failure}");
        }
        let member = |name: &str| open(Path::new(&format!("{}:{name}", path.display())));
        assert_eq!(content(&member("red").unwrap()), rays(2));
        assert_eq!(content(&member("x/blue").unwrap()), rays(1));
        assert!(member("green").err().unwrap().to_string().contains("file.member"));
        assert!(member("note.txt").err().unwrap().to_string().contains("detect.not_rays"));
        assert!(open(&folder.path().join("no.zip:red")).err().unwrap().to_string().contains("file.disk"));
        // A file whose name has a colon is itself.
        let odd = folder.path().join("lamp.zip:red");
        std::fs::write(&odd, rays(1)).unwrap();
        assert_eq!(content(&open(&odd).unwrap()), rays(1));
    }

    #[test]
    fn a_packed_file_without_rays_says_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zip");
        std::fs::write(&path, stored_zip(&[("note.txt", b"Hello.")])).unwrap();
        let failure = find(&path).err().unwrap().to_string();
        for part in ["container.no_ray_file", "note.txt", "detect.not_rays"] {
            assert!(failure.contains(part), "{failure}");
        }
    }
}
