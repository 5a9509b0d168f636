//! Unpacks an upload: every ray file in it becomes a ray set of its own, stored part by part as it comes out. What is no ray
//! file is left out and said so; a broken packed file gives nothing.

use super::declaration::FileDeclaration;
use super::error::Error;
use super::intake::Intake;
use super::rows::{Draft, LeftOut, Packed};
use super::spool::{Spool, Stored};
use crate::accounts::quota::Room;
use crate::storage::keys::new_id;
use pipeline::{Content, Member};
use tokio::runtime::Handle;
use tokio::task::spawn_blocking;
use tokio_util::sync::CancellationToken;

/// Bytes unpacked at once.
const BLOCK_BYTES: usize = 256 << 10;

impl Intake {
    /// The ray sets in a stored packed file, and what else is in it. On a thread of its own: unpacking computes. What comes
    /// out must find `room` as it does.
    ///
    /// # Errors
    /// [`Error::Packed`], [`Error::TooLarge`], [`Error::Quota`], [`Error::LowSpace`],
    /// [`Error::Storage`]; nothing unpacked is left behind.
    pub(super) async fn unpack(
        &self,
        packed: Stored,
        declared: FileDeclaration,
        room: Room,
        gone: CancellationToken,
    ) -> Result<(Vec<Draft>, Vec<LeftOut>), Error> {
        let unpacking = Unpacking {
            intake: self.clone(),
            runtime: Handle::current(),
            gone,
            packed: Packed { name: packed.name.clone(), sha256: packed.sha256.clone(), left_out: Vec::new() },
            declared,
            room,
            drafts: Vec::new(),
            left_out: Vec::new(),
        };
        let unpacked = spawn_blocking(move || unpacking.run(&packed));
        unpacked.await.map_err(|error| pipeline::Error::Internal(error.to_string()))?
    }
}

/// What has come out of a packed file so far.
struct Unpacking {
    intake: Intake,
    runtime: Handle,
    gone: CancellationToken,
    packed: Packed,
    declared: FileDeclaration,
    room: Room,
    drafts: Vec<Draft>,
    left_out: Vec<LeftOut>,
}

impl Unpacking {
    fn run(mut self, stored: &Stored) -> Result<(Vec<Draft>, Vec<LeftOut>), Error> {
        let (bytes, limits) = (self.intake.read(stored), self.intake.limits);
        let done = pipeline::unpack(&bytes, &stored.name, &limits, |name, content| self.visit(name, content));
        match done {
            Ok(()) if self.drafts.is_empty() => Err(Error::Packed(no_ray_file(&self.left_out))),
            Ok(()) => {
                for packed in self.drafts.iter_mut().filter_map(|draft| draft.ray_set.packed.as_mut()) {
                    packed.left_out.clone_from(&self.left_out);
                }
                Ok((self.drafts, self.left_out))
            }
            Err(error) => {
                for Draft { ray_set, .. } in &self.drafts {
                    self.runtime.block_on(self.intake.delete_blobs(&ray_set.id));
                }
                Err(error)
            }
        }
    }

    fn visit(&mut self, name: &str, content: Content<'_>) -> Result<(), Error> {
        let kept = match content {
            Content::Open(mut member) => self.keep(name, &mut member),
            Content::Closed(error) => Err(Error::Unfit(error)),
        };
        match kept {
            Ok(draft) => self.drafts.push(draft),
            Err(error) => self.left_out.push(left_out(name, error)?),
        }
        Ok(())
    }

    /// Stores a file in the packed one as a ray set to be.
    fn keep(&self, name: &str, member: &mut Member<'_>) -> Result<Draft, Error> {
        let id = new_id();
        let kept = self.store(&id, name, member).and_then(|stored| {
            let (packed, gone) = (Some(self.packed.clone()), self.gone.clone());
            self.runtime.block_on(self.intake.draft(stored, packed, &self.declared, gone))
        });
        kept.inspect_err(|_| self.runtime.block_on(self.intake.delete_blobs(&id)))
    }

    fn store(&self, id: &str, name: &str, member: &mut Member<'_>) -> Result<Stored, Error> {
        let mut spool = Spool::new(&self.intake, id, None);
        let filled = self.fill(&mut spool, member);
        // What is on its way must be there before it is deleted.
        let settled = self.runtime.block_on(spool.settle());
        filled.and(settled)?;
        self.runtime.block_on(spool.end(name.to_owned()))
    }

    fn fill(&self, spool: &mut Spool<'_>, member: &mut Member<'_>) -> Result<(), Error> {
        let before: u64 = self.drafts.iter().map(|draft| draft.ray_set.byte_count).sum();
        let mut block = vec![0; BLOCK_BYTES];
        loop {
            if self.gone.is_cancelled() {
                return Err(Error::Unfit(pipeline::Error::Cancelled));
            }
            let count = member.read(&mut block).map_err(Error::Packed)?;
            if count == 0 {
                return Ok(());
            }
            self.runtime.block_on(spool.push(block.get(..count).unwrap_or_default()))?;
            self.room.check(before + spool.byte_count())?;
        }
    }
}

/// Why a file is no ray set; any other error ends the whole upload.
fn left_out(name: &str, error: Error) -> Result<LeftOut, Error> {
    use pipeline::Error::{Malformed, Refused, Unusable};
    let code = match &error {
        Error::Unfit(unfit @ (Malformed(_) | Refused(_) | Unusable(_))) => unfit.code(),
        Error::Empty => "upload.empty",
        _ => return Err(error),
    };
    Ok(LeftOut { name: name.to_owned(), code: code.to_owned(), detail: error.to_string() })
}

fn no_ray_file(left_out: &[LeftOut]) -> pipeline::Error {
    pipeline::no_ray_file(left_out.iter().map(|file| (file.name.as_str(), file.code.as_str(), file.detail.as_str())))
}
