// A gamepad that a test holds in its hand: window.testPad.
(() => {
  let pad = null
  const tell = (type) => {
    const event = new Event(type)
    event.gamepad = pad
    dispatchEvent(event)
  }
  window.testPad = {
    rumbles: [],
    plug(axes = [0, 0, 0, 0]) {
      const buttons = Array.from({ length: 17 }, () => ({ pressed: false, touched: false, value: 0 }))
      const vibrationActuator = {
        effects: ['dual-rumble'],
        playEffect: (type, how) => {
          window.testPad.rumbles.push(how)
          return Promise.resolve('complete')
        },
      }
      pad = { id: 'Test pad', index: 0, connected: true, mapping: 'standard', timestamp: 0, axes, buttons, vibrationActuator }
      tell('gamepadconnected')
    },
    // forward and left are positive here, as on the robot
    deflect(forward, left) {
      clearInterval(window.testPad.hand)
      pad.axes = [-left, -forward, 0, 0]
      pad.timestamp = performance.now()
    },
    // as a hand holds it, which is never quite still
    hold(forward, left) {
      window.testPad.deflect(forward, left)
      let sign = 1
      window.testPad.hand = setInterval(() => {
        sign = -sign
        pad.axes = [-left * (1 - 0.005 * (1 + sign)), -forward * (1 - 0.005 * (1 + sign)), 0, 0]
        pad.timestamp = performance.now()
      }, 100)
    },
    press(number, down) {
      pad.buttons[number] = { pressed: down, touched: down, value: down ? 1 : 0 }
      pad.timestamp = performance.now()
    },
    unplug() {
      pad.connected = false
      tell('gamepaddisconnected')
      pad = null
    },
  }
  // another gamepad: window.otherPad, with axes and buttons as they lie; it was there before
  window.otherPad = null
  window.bumpOther = () => { // a browser tells of a pad when one of its buttons is pressed for the first time
    const event = new Event('gamepadconnected')
    event.gamepad = window.otherPad
    dispatchEvent(event)
  }
  window.layOther = (axes, pressed = []) => {
    const buttons = Array.from({ length: 17 }, (_, i) => ({ pressed: pressed.includes(i), touched: false, value: 0 }))
    window.otherPad = { id: 'Other pad', index: 1, connected: true, mapping: '', timestamp: performance.now(), axes, buttons }
  }
  navigator.getGamepads = () => [null, pad, window.otherPad, null]
})()
