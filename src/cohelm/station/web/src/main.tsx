import { render } from 'preact'
import { App } from './App'
import { startDriving } from './input/drive'
import { enter } from './session'
import { start } from './socket'
import './style.css'

// An address with the token in it logs in by itself; the token does not stay in the history.
const shown = () => new URLSearchParams(location.hash.slice(1)).get('token')
const token = shown()
if (token !== null) {
  history.replaceState(null, '', location.pathname)
  void enter(token).finally(start)
} else {
  start()
}
// ... also where the page is open already, and only what follows the # is new
addEventListener('hashchange', () => shown() !== null && location.reload())
startDriving()

const app = document.getElementById('app')
if (app !== null) render(<App />, app)
