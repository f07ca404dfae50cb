// Plays the frames: moves the point along the curves, and the device. Arrays are changed in place and
// only the views are told, so that nothing goes back to the server.
const SECONDS_A_PERIOD = 1.8
const MOST_A_SECOND = 40
let last = 0
let begun = null
let shown = null

function put(source, name, place, value) {
  source.data[name][place] = value
}

function step(now) {
  requestAnimationFrame(step)
  if (now - last < 1000 / MOST_A_SECOND) return
  last = now
  const data = frames.data
  const count = data.t.length
  if (count < 2) return
  if (data !== shown) { shown = data; if (begun === null) begun = now }
  const unit = about.data.per_period[0]
  const played = (now - begun) / 1000 / SECONDS_A_PERIOD * unit
  const i = Math.floor(played) % count
  for (const name of ["t", "series 0", "series 1", "x", "y"]) put(pointer, name, 0, data[name][i])
  pointer.change.emit()
  if (block === null) return
  const loops = Math.floor(played / count)
  const inner = about.data.inner[0]
  const half = about.data.half[0]
  const x2 = data.block[i]
  put(block, "x", 0, x2)
  block.change.emit()
  const teeth = spring.data.x.length
  for (let k = 0; k < teeth; k++) {
    put(spring, "x", k, -inner + (x2 - half + inner) * k / (teeth - 1))
  }
  spring.change.emit()
  put(plates, "charge", 0, data.right[i])
  put(plates, "charge", 1, data.left[i])
  plates.change.emit()
  const apart = about.data.apart[0]
  const gain = data.walk[count - 1] - data.walk[0]
  const walked = about.data.magnified[0] * (data.walk[i] + loops * gain)
  const shift = ((walked % apart) + apart) % apart
  const ticks = ground.data.x0.length
  for (let k = 0; k < ticks; k++) {
    put(ground, "x0", k, about.data.first[0] + apart * k - shift)
    put(ground, "x1", k, about.data.first[0] + apart * k - shift - 0.12)
  }
  ground.change.emit()
  const x1 = (data.x1[i] + loops * (data.x1[count - 1] - data.x1[0])) / about.data.factor[0]
  put(caption, "text", 0, `frame at x1 = ${x1.toPrecision(5)}${about.data.unit[0]}, ` +
    `its walk over the ground drawn ×${about.data.magnified[0]}`)
  caption.change.emit()
}
requestAnimationFrame(step)
