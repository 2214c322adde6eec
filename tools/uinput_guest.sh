#!/usr/bin/env bash
# Prove the force feedback of sticks against a kernel with uinput, in a virtual machine (opt-in).
# Where the kernel here has /dev/uinput this is not needed: the tests then do it by themselves.
#
#   apt-get install qemu-system-x86 busybox-static
#   tools/uinput_guest.sh [folder for the kernel, by default /tmp/cohelm-guest]
#
# The guest is Debian's kernel with this machine's files, read-only (9p); it runs tests/link/sticks/test_port.py.
set -euo pipefail
cd "$(dirname "$0")/.."
top=$PWD
at=${1:-/tmp/cohelm-guest}
command -v qemu-system-x86_64 >/dev/null && [ -x /bin/busybox ] || {
  echo "install qemu-system-x86 and busybox-static first" >&2; exit 2
}
mkdir -p "$at"
cd "$at"
if ! ls linux/boot/vmlinuz-* >/dev/null 2>&1; then
  apt-get download "$(apt-cache depends linux-image-amd64 | awk '/Depends: linux-image/ {print $2}')"
  dpkg-deb -x linux-image-*.deb linux
fi
release=$(basename linux/boot/vmlinuz-* | sed s/vmlinuz-//)
rm -rf root && mkdir -p root/{bin,proc,sys,dev,mnt,modules}
cp /bin/busybox root/bin/
# Modules in the order in which they need each other.
: > root/modules/order
wanted() {
  local file needs need
  file=$(find "linux/lib/modules/$release" -name "$1.ko*" | head -1)
  [ -n "$file" ] || return 0 # built in
  [ ! -e "root/modules/$(basename "$file")" ] || return 0
  cp "$file" root/modules/
  needs=$(grep -a -o -z '^depends=.*' "$file" | tr -d '\0')
  for need in $(echo "${needs#depends=}" | tr , ' '); do wanted "$need"; done
  basename "$file" >> root/modules/order
}
for module in virtio_pci 9pnet_virtio 9p evdev uinput; do wanted "$module"; done
cat > root/init <<INIT
#!/bin/busybox sh
/bin/busybox --install -s /bin
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
while read module; do insmod /modules/\$module || echo "no \$module"; done < /modules/order
mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose host /mnt || poweroff -f
mount -t devtmpfs dev /mnt/dev; mount -t proc proc /mnt/proc; mount -t sysfs sys /mnt/sys
mount -t tmpfs tmp /mnt/tmp
ip link set lo up
chroot /mnt /bin/sh -c 'cd $top && HOME=/tmp COHELM_CACHE_DIR=/tmp/cache PYTHONDONTWRITEBYTECODE=1 \
  .venv/bin/python -m pytest -p no:cacheprovider -q -rA tests/link/sticks/test_port.py -k "Evdev or kernel"; echo "guest: \$?"'
poweroff -f
INIT
chmod +x root/init
(cd root && find . | busybox cpio -o -H newc 2>/dev/null | gzip -1) > initrd.gz
fast=(-cpu max) # in software, where KVM is missing, or (nested) hangs: COHELM_SLOW_GUEST=1
[ -w /dev/kvm ] && [ -z "${COHELM_SLOW_GUEST:-}" ] && fast=(-enable-kvm -cpu host,-arch-capabilities)
timeout 600 qemu-system-x86_64 "${fast[@]}" -m 2048 -smp 2 -nographic -no-reboot \
  -kernel "linux/boot/vmlinuz-$release" -initrd initrd.gz -append "console=ttyS0 loglevel=4 panic=-1" \
  -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap \
  </dev/null | tee guest.log
grep -q "guest: 0" guest.log
