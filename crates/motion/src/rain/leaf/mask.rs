//! What of a leaf is leaf: its picture may cut holes into the mesh, and drops that fall through them go on.

use glam::DVec2;

use osier_scene::{Image, Material, Mesh, Pixels, pixel_at};

/// Which pixels of a leaf's picture are leaf.
/// Source: [yang-wu] 4, whose leaves have an alpha map; a pixel is a hole where the material's `alpha_cutoff` cuts it away.
#[derive(Debug, Clone)]
pub struct AlphaMask {
    size: [u32; 2],
    /// Rows from the top.
    whole: Vec<bool>,
}

impl AlphaMask {
    /// Of the materials that a mesh shows, the first whose picture cuts holes; none if no drop would fall through one.
    pub fn of(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| Self::cut(materials.get(s.material as usize)?, images))
    }

    fn cut(material: &Material, images: &[Image]) -> Option<Self> {
        let image = images.get(material.maps.color? as usize).filter(|i| i.channels == 4)?;
        let (cutoff, Pixels::U8(bytes)) = (material.alpha_cutoff?, &image.pixels) else { return None };
        let whole: Vec<bool> = bytes.chunks_exact(4).map(|p| f32::from(p[3]) / 255.0 >= cutoff).collect();
        let size = [image.width, image.height];
        let full = whole.len() == image.width as usize * image.height as usize;
        (full && whole.contains(&false)).then_some(Self { size, whole })
    }

    /// Whether there is leaf at texture coordinates, which repeat beyond 0 to 1.
    pub fn is_leaf(&self, uv: DVec2) -> bool {
        self.whole[pixel_at(uv.as_vec2(), self.size)]
    }
}
