//! Camera and lights.

use glam::{Mat3, Quat, Vec3};

use super::target::{Context, Target};
use super::value::Value;
use osier_base::Result;
use osier_base::math;
use osier_scene::{Fog, Trs};

/// Height of the picture on the film, tenths of a metre: 24 mm.
const FILM: f32 = 0.24;
/// Width to height of the picture.
const ASPECT: f32 = 16.0 / 9.0;

/// Writes camera, sun and sky under `root`. `picture`: path of the sky's equirectangular picture, seen from the layer; without one
/// the sky is of one colour.
pub(super) fn define(cx: &Context, target: &mut Target, root: &str, picture: Option<&str>) -> Result<()> {
    camera(cx, target, &format!("{root}/camera"))?;
    sun(cx, target, &format!("{root}/sun"))?;
    sky(cx, target, &format!("{root}/sky"), picture)?;
    fog(cx, target, &format!("{root}/fog"))
}

/// Haze as numbers for whoever renders: a prim whose properties Blender shows as its own. Density: per metre.
fn fog(cx: &Context, target: &mut Target, path: &str) -> Result<()> {
    let Some(fog) = cx.scene.sky.fog else { return Ok(()) };
    target.plain(path, "Xform")?;
    let property = |name: &str| format!("{path}.userProperties:fog_{name}");
    target.set(&property("color"), "color3f", Value::Float3(fog.color))?;
    target.set(&property("density"), "float", Value::Float(Fog::CONTRAST / fog.visibility))?;
    target.set(&property("height"), "float", Value::Float(fog.height))?;
    target.set(&property("visibility"), "float", Value::Float(fog.visibility))?;
    Ok(())
}

fn camera(cx: &Context, target: &mut Target, path: &str) -> Result<()> {
    let camera = &cx.scene.camera;
    target.plain(path, "Camera")?;
    let far = (camera.eye.length() + camera.target.length()) * 100.0 + 1000.0;
    let focal = FILM * 0.5 / math::tan_f32(camera.vfov * 0.5);
    target.set(&format!("{path}.clippingRange"), "float2", Value::Float2([0.01, far]))?;
    target.set(&format!("{path}.focalLength"), "float", Value::Float(focal))?;
    target.set(&format!("{path}.focusDistance"), "float", Value::Float((camera.target - camera.eye).length()))?;
    target.set(&format!("{path}.horizontalAperture"), "float", Value::Float(FILM * ASPECT))?;
    target.fix(&format!("{path}.projection"), "token", Value::Token("perspective"))?;
    target.set(&format!("{path}.verticalAperture"), "float", Value::Float(FILM))?;
    let [right, up, back] = camera.axes();
    let r = Quat::from_mat3(&Mat3::from_cols(right, up, back));
    let place = Trs { t: cx.up.vec(camera.eye), r: cx.up.stage_from_world() * r, s: Vec3::ONE };
    target.transform(path, &place)
}

fn sun(cx: &Context, target: &mut Target, path: &str) -> Result<()> {
    let sun = &cx.scene.sun;
    target.plain(path, "DistantLight")?;
    let degrees = sun.angle * 180.0 / std::f32::consts::PI;
    target.set(&format!("{path}.inputs:angle"), "float", Value::Float(degrees))?;
    target.set(&format!("{path}.inputs:color"), "color3f", Value::Float3(sun.color))?;
    // The measure of a light whose brightness does not depend on its angle, as Blender writes and reads it.
    target.set(&format!("{path}.inputs:intensity"), "float", Value::Float(sun.strength / 4.0))?;
    target.set(&format!("{path}.inputs:normalize"), "bool", Value::Bool(true))?;
    // Light leaves along -Z.
    let r = math::rotation_between(Vec3::Z, sun.direction());
    // Where it stands does not matter to the light, only to whoever wants to grab it.
    let t = cx.up.vec(cx.scene.camera.target + sun.direction() * 10.0);
    target.transform(path, &Trs { t, r: cx.up.stage_from_world() * r, s: Vec3::ONE })
}

fn sky(cx: &Context, target: &mut Target, path: &str, picture: Option<&str>) -> Result<()> {
    let sky = &cx.scene.sky;
    target.plain(path, "DomeLight")?;
    if let Some(picture) = picture {
        target.set(&format!("{path}.inputs:intensity"), "float", Value::Float(1.0))?;
        target.set(&format!("{path}.inputs:texture:file"), "asset", Value::Asset(picture))?;
        target.set(&format!("{path}.inputs:texture:format"), "token", Value::Token("latlong"))?;
        // The pole of such a picture is +Y on every stage.
        return target.transform(path, &Trs { r: cx.up.stage_from_world(), ..Trs::IDENTITY });
    }
    let mean: [f32; 3] = std::array::from_fn(|i| (sky.horizon[i] + sky.zenith[i]) * 0.5);
    target.set(&format!("{path}.inputs:color"), "color3f", Value::Float3(mean))?;
    target.set(&format!("{path}.inputs:intensity"), "float", Value::Float(sky.strength))?;
    Ok(())
}
