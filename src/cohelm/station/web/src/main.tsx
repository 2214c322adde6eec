import { render } from 'preact'
import { App } from './App'
import { startDriving } from './input/drive'
import { login } from './panels/Login'
import { start } from './socket'
import './style.css'

// An address with the token in it logs in by itself; the token does not stay in the history.
const token = new URLSearchParams(location.hash.slice(1)).get('token')
if (token !== null) {
  history.replaceState(null, '', location.pathname)
  void login(token).finally(start)
} else {
  start()
}
startDriving()

const app = document.getElementById('app')
if (app !== null) render(<App />, app)
