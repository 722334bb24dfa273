// Display: exposure, tone curve, sRGB encoding. Twin of src/display.rs, where the papers are named.

struct Display {
    width: u32,
    height: u32,
    // 0 AgX, 1 ACES, 2 neutral, 3 Reinhard, 4 linear.
    tone: u32,
    // Display-linear value per nit.
    gain: f32,
    // White balance; the identity where there is none.
    balance: mat3x3<f32>,
    // 0 rounds, 1 dithers.
    dither: u32,
    // 0 no false color, 1 by ratio, 2 by difference.
    spacing: u32,
    // Start of the scale, and reciprocal of its length, in the measure of its spacing.
    scale_start: f32,
    scale_per_unit: f32,
    // 1 where there is a layer to add.
    layered: u32,
}

@group(0) @binding(0) var<uniform> display_params: Display;
@group(0) @binding(1) var<storage, read> radiance: array<vec4<f32>>;
@group(0) @binding(2) var picture: texture_storage_2d<rgba8unorm, write>;
// Red, green and blue of each pixel, row by row; one unused float where there is no layer.
@group(0) @binding(3) var<storage, read> layer: array<f32>;

@compute @workgroup_size(16, 16)
fn display(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= display_params.width || id.y >= display_params.height {
        return;
    }
    let pixel = id.y * display_params.width + id.x;
    var nit = radiance[pixel].xyz;
    if display_params.layered != 0u {
        nit += vec3<f32>(layer[3u * pixel], layer[3u * pixel + 1u], layer[3u * pixel + 2u]);
    }
    if display_params.spacing != 0u {
        textureStore(picture, id.xy, vec4<f32>(turbo(place(luminance(finite(nit)))), 1.0));
        return;
    }
    let gained = nit * display_params.gain;
    let exposed = select(vec3<f32>(0.0), min(gained, vec3<f32>(1e6)), gained > vec3<f32>(0.0));
    let balanced = clamp(display_params.balance * exposed, vec3<f32>(0.0), vec3<f32>(1e6));
    var linear = balanced;
    switch display_params.tone {
        case 0u: { linear = agx(balanced); }
        case 1u: { linear = aces(balanced); }
        case 2u: { linear = neutral(balanced); }
        case 3u: { linear = reinhard(balanced); }
        default: {}
    }
    var encoded = srgb_from_linear(clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0)));
    if display_params.dither != 0u {
        encoded = floor(255.0 * encoded + threshold(id.x, id.y)) / 255.0;
    }
    textureStore(picture, id.xy, vec4<f32>(encoded, 1.0));
}

// 0 for what is no number; what is beyond all numbers is the most that there is. Told by the bits: compilers may take numbers for granted.
fn finite(rgb: vec3<f32>) -> vec3<f32> {
    let magnitude = bitcast<vec3<u32>>(rgb) & vec3<u32>(0x7fffffffu);
    let bounded = clamp(rgb, vec3<f32>(-1e30), vec3<f32>(1e30));
    return select(bounded, vec3<f32>(0.0), magnitude > vec3<u32>(0x7f800000u));
}

fn luminance(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3<f32>(0.2126, 0.7152, 0.0722));
}

// Place of a value on the scale of false color.
fn place(value: f32) -> f32 {
    var bent = value;
    if display_params.spacing == 1u {
        bent = log2(max(value, 1.17549435e-38));
    }
    return clamp((bent - display_params.scale_start) * display_params.scale_per_unit, 0.0, 1.0);
}

fn turbo(x: f32) -> vec3<f32> {
    let c0 = vec3<f32>(0.13572138, 0.09140261, 0.1066733);
    let c1 = vec3<f32>(4.6153926, 2.1941884, 12.641946);
    let c2 = vec3<f32>(-42.660323, 4.8429666, -60.58205);
    let c3 = vec3<f32>(132.13108, -14.185033, 110.36277);
    let c4 = vec3<f32>(-152.94239, 4.2772986, -89.90311);
    let c5 = vec3<f32>(59.28638, 2.829566, 27.34825);
    return clamp(((((c5 * x + c4) * x + c3) * x + c2) * x + c1) * x + c0, vec3<f32>(0.0), vec3<f32>(1.0));
}

// Twin of src/display/dither.rs, in bytes.
fn threshold(x: u32, y: u32) -> f32 {
    let at = (x * 3242174889u + y * 2447445413u) >> 23u;
    return f32(select(511u - at, at, at < 256u)) / 256.0;
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

fn aces(rgb: vec3<f32>) -> vec3<f32> {
    // Columns of the matrices.
    let into = mat3x3<f32>(
        vec3<f32>(0.59719, 0.076, 0.0284),
        vec3<f32>(0.35458, 0.90834, 0.13383),
        vec3<f32>(0.04823, 0.01566, 0.83777),
    );
    let out = mat3x3<f32>(
        vec3<f32>(1.60475, -0.10208, -0.00327),
        vec3<f32>(-0.53108, 1.10813, -0.07276),
        vec3<f32>(-0.07367, -0.00605, 1.07602),
    );
    let v = into * rgb;
    return out * ((v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081));
}

fn reinhard(rgb: vec3<f32>) -> vec3<f32> {
    let y = luminance(rgb);
    return rgb * ((1.0 + y * 0.0625) / (1.0 + y));
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
