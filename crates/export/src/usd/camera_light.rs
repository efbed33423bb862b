//! Camera, sun, sky and fog.

use glam::{Mat3, Quat, Vec3};

use super::context::UsdContext;
use super::layer::LayerBuilder;
use super::value::UsdValue;
use osier_base::Result;
use osier_base::math;
use osier_scene::{Fog, Trs};

/// Vertical aperture in tenths of the scene unit, as UsdGeomCamera has it: 24 mm.
const VERTICAL_APERTURE: f32 = 0.24;

/// Defines camera, sun, sky and fog below `root`. `aspect`: width over height of the camera's picture; `picture`: path
/// of the sky's equirectangular image, relative to the layer; without it the sky has a single colour.
pub(super) fn define_camera_and_lights(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    aspect: f32,
    picture: Option<&str>,
) -> Result<()> {
    define_camera(cx, layer, &format!("{root}/camera"), aspect)?;
    define_sun(cx, layer, &format!("{root}/sun"))?;
    define_sky(cx, layer, &format!("{root}/sky"), picture)?;
    define_fog_properties(cx, layer, &format!("{root}/fog"))
}

/// Defines fog as a prim with user properties, which Blender imports as custom properties; USD has no schema for fog. The
/// density, 1/m, is the extinction coefficient that follows from the visibility.
fn define_fog_properties(cx: &UsdContext, layer: &mut LayerBuilder, path: &str) -> Result<()> {
    let Some(fog) = cx.scene.sky.fog else { return Ok(()) };
    layer.define_plain_prim(path, "Xform")?;
    let property = |name: &str| format!("{path}.userProperties:fog_{name}");
    layer.set_attr(&property("color"), "color3f", UsdValue::Float3(fog.color))?;
    layer.set_attr(&property("density"), "float", UsdValue::Float(Fog::CONTRAST / fog.visibility))?;
    layer.set_attr(&property("height"), "float", UsdValue::Float(fog.height))?;
    layer.set_attr(&property("visibility"), "float", UsdValue::Float(fog.visibility))?;
    Ok(())
}

fn define_camera(cx: &UsdContext, layer: &mut LayerBuilder, path: &str, aspect: f32) -> Result<()> {
    let camera = &cx.scene.camera;
    layer.define_plain_prim(path, "Camera")?;
    // Pinhole camera: tan(vfov / 2) = (aperture / 2) / focal length, both in tenths of the scene unit.
    let focal = VERTICAL_APERTURE * 0.5 / math::tan_f32(camera.vfov * 0.5);
    layer.set_attr(&format!("{path}.clippingRange"), "float2", UsdValue::Float2(camera.clipping_range()))?;
    layer.set_attr(&format!("{path}.focalLength"), "float", UsdValue::Float(focal))?;
    layer.set_attr(
        &format!("{path}.focusDistance"),
        "float",
        UsdValue::Float((camera.target - camera.eye).length()),
    )?;
    layer.set_attr(&format!("{path}.horizontalAperture"), "float", UsdValue::Float(VERTICAL_APERTURE * aspect))?;
    layer.set_uniform(&format!("{path}.projection"), "token", UsdValue::Token("perspective"))?;
    layer.set_attr(&format!("{path}.verticalAperture"), "float", UsdValue::Float(VERTICAL_APERTURE))?;
    let [right, up, back] = camera.axes();
    let r = Quat::from_mat3(&Mat3::from_cols(right, up, back));
    let place = Trs { t: cx.up.stage_vec(camera.eye), r: cx.up.world_to_stage() * r, s: Vec3::ONE };
    layer.set_xform_ops(path, &place)
}

fn define_sun(cx: &UsdContext, layer: &mut LayerBuilder, path: &str) -> Result<()> {
    let sun = &cx.scene.sun;
    layer.define_plain_prim(path, "DistantLight")?;
    let degrees = sun.angle * 180.0 / std::f32::consts::PI;
    layer.set_attr(&format!("{path}.inputs:angle"), "float", UsdValue::Float(degrees))?;
    layer.set_attr(&format!("{path}.inputs:color"), "color3f", UsdValue::Float3(sun.color))?;
    // A normalised light: its illumination does not depend on the angle. The factor 4 is the convention of Blender's exporter and
    // importer.
    layer.set_attr(&format!("{path}.inputs:intensity"), "float", UsdValue::Float(sun.strength / 4.0))?;
    layer.set_attr(&format!("{path}.inputs:normalize"), "bool", UsdValue::Bool(true))?;
    // A distant light emits along its -Z.
    let r = math::rotation_between(Vec3::Z, sun.direction());
    // The position has no effect on the light; near the target it is easy to select.
    let t = cx.up.stage_vec(cx.scene.camera.target + sun.direction() * 10.0);
    layer.set_xform_ops(path, &Trs { t, r: cx.up.world_to_stage() * r, s: Vec3::ONE })
}

fn define_sky(cx: &UsdContext, layer: &mut LayerBuilder, path: &str, picture: Option<&str>) -> Result<()> {
    let sky = &cx.scene.sky;
    layer.define_plain_prim(path, "DomeLight")?;
    if let Some(picture) = picture {
        layer.set_attr(&format!("{path}.inputs:intensity"), "float", UsdValue::Float(1.0))?;
        layer.set_attr(&format!("{path}.inputs:texture:file"), "asset", UsdValue::Asset(picture))?;
        layer.set_attr(&format!("{path}.inputs:texture:format"), "token", UsdValue::Token("latlong"))?;
        // The pole of a `latlong` texture is the light's +Y, whatever the up axis of the stage.
        return layer.set_xform_ops(path, &Trs { r: cx.up.world_to_stage(), ..Trs::IDENTITY });
    }
    // The mean of the two ends of the gradient, not weighted by solid angle.
    let mean: [f32; 3] = std::array::from_fn(|i| (sky.horizon[i] + sky.zenith[i]) * 0.5);
    layer.set_attr(&format!("{path}.inputs:color"), "color3f", UsdValue::Float3(mean))?;
    layer.set_attr(&format!("{path}.inputs:intensity"), "float", UsdValue::Float(sky.strength))?;
    Ok(())
}
