// Plays the frames: moves a point along the curves, and the device. The points are elements above
// the figures, which need not be painted again for them. Of the device arrays are changed in place and
// only the view is told, so that nothing goes back to the server.
const FRAMES_A_SECOND = 56
const MOST_A_SECOND = 25 // that are drawn
const REST = 300 // ms in which a slider may move on: drawing the next picture goes before playing
const still = matchMedia("(prefers-reduced-motion: reduce)")
let begun = null
let last = 0
let shown = null
let paused = 0
let dots = null

function dot() {
  const made = document.createElement("div")
  made.className = "point"
  document.getElementById("points").append(made)
  return made
}

function put(point, model, x, y) {
  const view = Bokeh.index.find_one(model)
  if (view === null || !Number.isFinite(x) || !Number.isFinite(y)) {
    point.hidden = true
    return
  }
  const place = view.el.getBoundingClientRect()
  const at = [view.frame.x_scale.compute(x), view.frame.y_scale.compute(y)]
  point.hidden = !view.frame.bbox.contains(...at)
  const left = place.left + window.scrollX + at[0]
  const top = place.top + window.scrollY + at[1]
  point.style.transform = `translate(${left}px, ${top}px)`
}

function move(data, i, loops) {
  const count = data.t.length
  const {block, spring, plates, ground, caption, inner, half, spacing, first} = device
  const x2 = data.block[i]
  block.data.x[0] = x2
  const teeth = spring.data.x.length
  for (let k = 0; k < teeth; k++) {
    spring.data.x[k] = -inner + (x2 - half + inner) * k / (teeth - 1)
  }
  plates.data.charge[0] = data.right[i]
  plates.data.charge[1] = data.left[i]
  const magnified = caption.data.magnified[0]
  const walked = magnified * (data.walk[i] + loops * (data.walk[count - 1] - data.walk[0]))
  const shift = ((walked % spacing) + spacing) % spacing
  for (let k = 0; k < ground.data.x0.length; k++) {
    ground.data.x0[k] = first + spacing * k - shift
    ground.data.x1[k] = ground.data.x0[k] - 0.12
  }
  const x1 = data.x1[i] + loops * (data.x1[count - 1] - data.x1[0])
  caption.data.text[0] = `frame at x1 = ${x1.toPrecision(5)} ${caption.data.unit[0]}`.trimEnd() +
    `,\nits walk over the ground drawn ×${magnified}`  // two lines, to fit a phone
  for (const part of [block, spring, plates, ground, caption]) part.change.emit()
}

function step(now) {
  if (still.matches) setTimeout(() => requestAnimationFrame(step), REST)
  else requestAnimationFrame(step)
  if (now - last < 1000 / MOST_A_SECOND) return
  const passed = now - last
  last = now
  const data = frames.data
  if (data.t.length < 2) return
  if (begun === null) {
    begun = now
    dots = [...series, portrait].map(dot)
  }
  const changed = data !== shown
  if (changed) {
    shown = data
    paused = now
  }
  const resting = still.matches || now - Math.max(paused, window.slider_moved ?? 0) < REST
  if (resting) begun += passed
  const played = Math.max(0, now - begun) / 1000 * FRAMES_A_SECOND
  const i = Math.floor(played) % data.t.length
  series.forEach((model, k) => put(dots[k], model, data.t[i], data[`series ${k}`][i]))
  put(dots[series.length], portrait, data.x[i], data.y[i])
  if (device !== null && (changed || !resting)) move(data, i, Math.floor(played / data.t.length))
}
requestAnimationFrame(step)
