#!/bin/sh
# One GPIO chip with the lines relay, lamp and sense; vivid's HDMI output as the scanner, its HDMI input as the grabber.
set -e
mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
chip=/sys/kernel/config/gpio-sim/cart
if [ ! -d $chip ]; then
    mkdir -p $chip/bank0
    echo 4 >$chip/bank0/num_lines
    echo cart >$chip/bank0/label
    n=0
    for name in relay lamp sense spare; do
        mkdir $chip/bank0/line$n
        echo $name >$chip/bank0/line$n/name
        n=$((n + 1))
    done
    echo 1 >$chip/live
fi

in="v4l2-ctl -d /dev/video0" out="v4l2-ctl -d /dev/video1"
$in -i 1 >/dev/null
$in --set-dv-bt-timings index=0 >/dev/null
$out --set-dv-bt-timings index=0 >/dev/null
$in --set-fmt-video width=640,height=480,pixelformat=GREY
$out --set-fmt-video-out width=640,height=480,pixelformat=GREY
# The default stamps the end of a picture nine tenths of a picture ahead of time.
$in -c osd_text_mode=2,timestamp_source=1
if $in -l | grep -q loop_video; then
    $in -c loop_video=1
else
    control=$($in -l | grep -o 'hdmi_[0-9_]*is_connected_to' | head -n 1)
    choice=$($in -L | sed -n "/$control/,/0x/p" | grep -E '^[[:space:]]+[0-9]+: .*[Oo]utput' | head -n 1 | cut -d: -f1 | tr -d '[:space:]')
    $in -c "$control=$choice"
fi
