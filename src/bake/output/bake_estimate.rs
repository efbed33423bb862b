//! The counts and bytes that an estimate holds.

use osier_base::Result;
use osier_base::limits::Limits;

/// Numbers of things, over all assets.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BakeEstimate {
    /// Assets with files of their own.
    pub assets: u64,
    /// Placements of assets in the scene; several may show one asset.
    pub placements: u64,
    /// Modules of the final strings of all individuals; 0 if no grammar grows a plant.
    pub modules: u64,
    /// Vertices of meshes, prototypes counted once.
    pub vertices: u64,
    /// Triangles of meshes, prototypes counted once.
    pub triangles: u64,
    /// Instances of all instancers; those of an asset count once, however often it is placed.
    pub instances: u64,
    /// Points of all clouds; those of an asset count once, however often it is placed.
    pub points: u64,
    /// Joints of all skeletons; those of an asset count once, however often it is placed.
    pub joints: u64,
    /// Frames that are written; 0 for a still scene.
    pub frames: u64,
    /// Predicted bytes of all files: the sum of `sizes`.
    pub bytes: u64,
    /// Of these, what each format takes, by its word, and pictures.
    pub sizes: Vec<(&'static str, u64)>,
    /// Bytes of memory at the peak of the run, by what they are for.
    pub memory: Vec<(&'static str, u64)>,
}

impl BakeEstimate {
    /// Bytes of memory at the peak of the run.
    pub fn peak(&self) -> u64 {
        self.memory.iter().map(|p| p.1).sum()
    }

    /// Compares the bytes written and the peak of memory with the limits `output-bytes` and `memory`.
    /// # Errors
    /// `Limit` for the first that is exceeded.
    pub fn check_limits(&self, limits: &Limits) -> Result<()> {
        limits.check("output-bytes", self.bytes, "the predicted size of the output, in bytes,")?;
        limits.check("memory", self.peak(), "the predicted peak of memory, in bytes,")
    }
}
