// Display: exposure, tone curve, sRGB encoding. Twin of src/display.rs, where the papers are named.

struct Display {
    width: u32,
    height: u32,
    // 0 AgX, 1 neutral, 2 linear.
    tone: u32,
    // Display-linear value per nit.
    gain: f32,
}

@group(0) @binding(0) var<uniform> display_params: Display;
@group(0) @binding(1) var<storage, read> radiance: array<vec4<f32>>;
@group(0) @binding(2) var picture: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn display(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= display_params.width || id.y >= display_params.height {
        return;
    }
    let nit = radiance[id.y * display_params.width + id.x].xyz;
    let exposed = clamp(nit * display_params.gain, vec3<f32>(0.0), vec3<f32>(1e6));
    var linear = exposed;
    switch display_params.tone {
        case 0u: { linear = agx(exposed); }
        case 1u: { linear = neutral(exposed); }
        default: {}
    }
    textureStore(picture, id.xy, vec4<f32>(srgb_from_linear(clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0))), 1.0));
}

fn srgb_from_linear(linear: vec3<f32>) -> vec3<f32> {
    let curve = 1.055 * pow(linear, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * linear, linear <= vec3<f32>(0.0031308));
}

fn agx(rgb: vec3<f32>) -> vec3<f32> {
    // Columns of the matrices.
    let inset = mat3x3<f32>(
        vec3<f32>(0.84247906, 0.042328242, 0.042375655),
        vec3<f32>(0.0784336, 0.87846864, 0.0784336),
        vec3<f32>(0.079223745, 0.07916613, 0.87914297),
    );
    let outset = mat3x3<f32>(
        vec3<f32>(1.196879, -0.05289685, -0.052971635),
        vec3<f32>(-0.09802088, 1.1519031, -0.09804345),
        vec3<f32>(-0.09902974, -0.09896118, 1.1510737),
    );
    let low = -12.47393;
    let high = 4.026069;
    let stops = clamp(log2(max(inset * rgb, vec3<f32>(1e-10))), vec3<f32>(low), vec3<f32>(high));
    let bent = agx_contrast((stops - low) / (high - low));
    return pow(max(outset * bent, vec3<f32>(0.0)), vec3<f32>(2.2));
}

fn agx_contrast(x: vec3<f32>) -> vec3<f32> {
    return (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
}

fn neutral(rgb: vec3<f32>) -> vec3<f32> {
    let start = 0.8 - 0.04;
    let desaturation = 0.15;
    let least = min(rgb.x, min(rgb.y, rgb.z));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let lowered = rgb - offset;
    let peak = max(lowered.x, max(lowered.y, lowered.z));
    if peak < start {
        return lowered;
    }
    let room = 1.0 - start;
    let new_peak = 1.0 - room * room / (peak + room - start);
    let white = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0);
    return mix(lowered * new_peak / peak, vec3<f32>(new_peak), white);
}
