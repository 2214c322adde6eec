import { effect } from '@preact/signals'
import { render } from 'preact'
import { App } from './App'
import { startDriving } from './input/drive'
import { heedFurtherFingers } from './input/fingers'
import { keepFocus } from './input/focus'
import { wrong } from './panels/Login'
import { logIn } from './session'
import { start } from './socket'
import * as s from './state'
import './style.css'

// An address that contains the token logs in; the token is removed from the history.
const shown = () => new URLSearchParams(location.hash.slice(1)).get('token')
const token = shown()
if (token !== null) {
  history.replaceState(null, '', location.pathname)
  void logIn(token).then((why) => (wrong.value = why && `${why} Each start of the station has its own: open the newest one.`)).finally(start)
} else {
  start()
}
// ... also if the page is open already, and only the part after # is new
addEventListener('hashchange', () => shown() !== null && location.reload())
startDriving()
heedFurtherFingers()
addEventListener('error', ({ error }) => {
  if (error instanceof Error) s.failed.value = true // others are no fault of ours: of a size observer, of an extension
})
effect(() => {
  document.title = s.title.value
})

const app = document.getElementById('app')
if (app !== null) {
  keepFocus(app)
  render(<App />, app)
}
